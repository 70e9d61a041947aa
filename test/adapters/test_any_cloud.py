"""Clouds of any layout and content: read as finite detections, or refused under a known name."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import ClassVar

import hypothesis
import numpy as np
from hypothesis import strategies as st

from msg_adapters import MessageError, read_detections
from tsepm_ros.session.drop_reasons import DROP_REASONS, reason_of

NAMES = ["range", "azimuth", "bearing", "x", "y", "z", "time_offset", "range_std", "intensity", ""]
STEPS = st.one_of(st.integers(0, 64), st.sampled_from([2**16, 2**31, 2**32 - 1]))


@dataclass
class Cloud:
    """A PointCloud2 by its attributes, which may contradict each other."""

    __msgtype__: ClassVar[str] = "sensor_msgs/msg/PointCloud2"
    height: int
    width: int
    fields: list
    is_bigendian: bool
    point_step: int
    row_step: int
    data: bytes
    is_dense: bool = True
    header: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(
            stamp=SimpleNamespace(sec=5, nanosec=0), frame_id="sonar"
        )
    )


fields = st.builds(
    SimpleNamespace,
    name=st.sampled_from(NAMES),
    offset=st.one_of(st.sampled_from([0, 4, 8, 12, 16, 24]), STEPS),
    datatype=st.one_of(st.sampled_from([7, 8]), st.integers(0, 255)),
    count=st.one_of(st.just(1), STEPS),
)
clouds = st.builds(
    Cloud,
    height=st.one_of(st.just(1), STEPS),
    width=STEPS,
    fields=st.lists(fields, max_size=6),
    is_bigendian=st.booleans(),
    point_step=STEPS,
    row_step=STEPS,
    data=st.binary(max_size=400),
)


@st.composite
def fitting(draw):
    """Clouds whose sizes agree, with any bytes as numbers."""
    names = draw(st.lists(st.sampled_from(NAMES[:-1]), min_size=2, max_size=6, unique=True))
    names = [*{"range": 0, "azimuth": 0, **dict.fromkeys(names, 0)}]
    width = draw(st.integers(0, 6))
    made = [
        SimpleNamespace(name=name, offset=8 * i, datatype=8, count=1)
        for i, name in enumerate(names)
    ]
    step = 8 * len(names)
    size = width * step
    data = draw(st.binary(min_size=size, max_size=size))
    return Cloud(1, width, made, draw(st.booleans()), step, size, data)


@hypothesis.settings(max_examples=400, deadline=None, derandomize=True, database=None)
@hypothesis.given(cloud=st.one_of(clouds, fitting()), speed=st.sampled_from([0.0, 1500.0]))
def test_any_cloud_is_read_or_refused(cloud, speed):
    try:
        ping = read_detections(cloud, sound_speed=speed)
    except MessageError as error:
        assert reason_of(error.reason).lost == "scan"
        assert error.reason in DROP_REASONS
        return
    scan = ping.sensor_scan.scan
    assert set(ping.dropped) <= set(DROP_REASONS)
    assert len(scan) + sum(ping.dropped.values()) == cloud.width * cloud.height
    for values in (scan.range, scan.azimuth, scan.range_std, scan.azimuth_std, scan.time_offset):
        assert values is None or np.isfinite(values).all()
    assert (scan.range > 0).all() and (np.abs(scan.azimuth) <= np.pi).all()
