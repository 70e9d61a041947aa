# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""A driver in 25 lines: each ping is a cloud, a point per detection with range and azimuth."""

import time
from contextlib import suppress

import numpy as np
import rclpy
from sensor_msgs.msg import PointCloud2, PointField

rclpy.init()
node = rclpy.create_node("minimal_driver")
publisher = node.create_publisher(PointCloud2, "detections", 10)
names = ("range", "azimuth")  # m, and rad counter-clockwise from the sensor's x axis (ahead)
fields = [PointField(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate(names)]
begin, random = time.monotonic(), np.random.default_rng()
with suppress(KeyboardInterrupt):
    while rclpy.ok():
        x, y = random.uniform(-300, 300, (2, 6))  # your sonar instead: five false detections
        x[0], y[0] = time.monotonic() - begin - 100, 150  # and a target that passes at 1 m/s
        points = np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1).astype(np.float32)
        cloud = PointCloud2(height=1, width=len(points), fields=fields, point_step=8)
        cloud.header.frame_id, cloud.header.stamp = "sonar", node.get_clock().now().to_msg()
        cloud.row_step, cloud.data = points.nbytes, points.tobytes()  # all float32 (datatype 7)
        publisher.publish(cloud)
        time.sleep(1.0)
