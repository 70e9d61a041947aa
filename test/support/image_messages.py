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
"""Sonar images in messages of marine_acoustic_msgs, of 4 beams and 3 ranges."""

import math

import numpy as np
from geometry_msgs.msg import Vector3

from msg_adapters import make_header
from msg_adapters.image_messages import DTYPES
from support import foreign_messages as foreign

HEADER = make_header(1_700_000_000_123_456_789, "sonar")
BEAMS, CELLS = np.array([0.5, 0.1, -0.05, -0.4]), np.array([2.5, 3.0, 4.0])  # port to starboard
TABLE = np.arange(12).reshape(4, 3)  # beam by beam


def data(table, kind="u1", big=False):
    form = np.dtype(kind).newbyteorder(">" if big else "<")
    return foreign.SonarImageData(
        is_bigendian=big,
        dtype=DTYPES.index(kind),
        beam_count=4,
        data=np.ascontiguousarray(table).astype(form).tobytes(),
    )


def projected(table=TABLE.T, speed=1480.0, cells=CELLS, up=0.0, **image):
    directions = [Vector3(x=up, y=-math.sin(a), z=math.cos(a)) for a in BEAMS]
    return foreign.ProjectedSonarImage(
        header=HEADER,
        ping_info=foreign.PingInfo(sound_speed=speed),
        beam_directions=directions,
        ranges=list(cells),
        image=data(table, **image),
    )


def raw(table=TABLE, **fields):
    values = {
        "header": HEADER,
        "ping_info": foreign.PingInfo(sound_speed=1500.0),
        "sample_rate": 750.0,
        "samples_per_beam": 3,
        "sample0": 5,
        "rx_angles": (-BEAMS).tolist(),
        "image": data(table),
    }
    return foreign.RawSonarImage(**(values | fields))
