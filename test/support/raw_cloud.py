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
"""PointCloud2 messages packed byte by byte with struct: no code shared with the adapters."""

import struct
from collections.abc import Iterable, Sequence

from sensor_msgs.msg import PointCloud2, PointField

DATATYPES = {
    "b": PointField.INT8,
    "B": PointField.UINT8,
    "h": PointField.INT16,
    "H": PointField.UINT16,
    "i": PointField.INT32,
    "I": PointField.UINT32,
    "f": PointField.FLOAT32,
    "d": PointField.FLOAT64,
}


def raw_cloud(
    fields: Iterable[tuple[str, str]],
    points: Sequence[Sequence[float]],
    *,
    gap: int = 0,
    big_endian: bool = False,
    height: int = 1,
    row_padding: int = 0,
    stamp: tuple[int, int] = (1_700_000_000, 123_456_789),
    frame_id: str = "sonar",
) -> PointCloud2:
    """Pack points of fields (name, struct format); rubbish stands in the gaps and after rows."""
    order = ">" if big_endian else "<"
    cloud = PointCloud2(height=height, width=len(points) // height, is_bigendian=big_endian)
    cloud.header.stamp.sec, cloud.header.stamp.nanosec = stamp
    cloud.header.frame_id = frame_id
    rubbish = b"\xff" * gap
    offset = 0
    for name, code in fields:
        offset += gap
        cloud.fields.append(PointField(name=name, offset=offset, datatype=DATATYPES[code], count=1))
        offset += struct.calcsize(code)
    cloud.point_step = offset + gap
    cloud.row_step = cloud.width * cloud.point_step + row_padding
    data, codes = bytearray(), [order + code for _, code in fields]
    for start in range(0, len(points), max(cloud.width, 1)):
        for point in points[start : start + cloud.width]:
            for code, value in zip(codes, point, strict=True):
                data += rubbish + struct.pack(code, value)
            data += rubbish
        data += b"\xff" * row_padding
    cloud.data = bytes(data)
    return cloud
