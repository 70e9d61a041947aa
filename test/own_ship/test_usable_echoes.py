"""An echo at an impossible time costs itself, not its ping."""

import numpy as np
import pytest

from msg_adapters.ping import ReadingOptions
from msg_adapters.point_cloud_detections import detections_of_fields
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.replay.offline import process_recording
from tsepm_ros.tools.replay.recording import RecordedMotion, RecordedScan, Recording

MOVING = Settings(session=SessionOptions(own_ship_source="odometry"))


def pose(stamp: float) -> PoseSample:
    return PoseSample(stamp, 0.0, 0.0, 0.0, frame_id="odom", child_frame_id="sonar")


def ping(stamp: float, offsets: list[float]):
    values = {
        "range": np.full(len(offsets), 900.0),
        "azimuth": np.linspace(-1.0, 1.0, len(offsets)),
        "time_offset": np.array(offsets),
    }
    read = detections_of_fields(round(1e9 * stamp), "sonar", values, ReadingOptions())
    return read.sensor_scan


@pytest.mark.parametrize("wrong", [60.0, 61.0, 1e3, 1e6, -60.0, -1e6])
def test_the_other_echoes_of_the_ping_are_used_at_once(wrong):
    session = Session(MOVING)
    for stamp in np.arange(0.0, 30.0, 0.5):
        session.add_own_ship(pose(stamp))
    session.add_scan(ping(10.0, [0.6, wrong, 0.5]), now=0.0)
    [result] = session.process(now=0.0)
    assert len(result.scan) == 2
    assert result.scan.time_offset.tolist() == [0.6, 0.5]
    assert session.dropped == {"echo_too_late": 1}


def test_a_ping_of_nothing_else_is_an_empty_ping():
    session = Session(MOVING)
    for stamp in np.arange(0.0, 30.0, 0.5):
        session.add_own_ship(pose(stamp))
    session.add_scan(ping(10.0, [100.0, 200.0]), now=0.0)
    [result] = session.process(now=0.0)
    assert len(result.scan) == 0
    assert session.dropped == {"echo_too_late": 2}


def test_a_sensor_at_rest_keeps_such_echoes():
    session = Session(Settings())
    session.add_scan(ping(10.0, [0.6, 100.0]), now=0.0)
    [result] = session.process(now=0.0)
    assert len(result.scan) == 2
    assert not session.dropped


@pytest.mark.long
def test_offline_the_poses_of_later_pings_are_still_there():
    """The poses up to the last echo are read before a ping: none must be read for a wrong one."""
    times = np.arange(0.0, 2000.0, 1.0)
    scans = [
        RecordedScan(
            float(stamp),
            {
                "range": np.full(3, 900.0),
                "azimuth": np.array([0.0, 0.1, 0.2]),
                "time_offset": np.array([0.5, 1e5 if stamp == 20.0 else 0.6, 0.7]),
            },
        )
        for stamp in np.arange(20.0, 1900.0, 20.0)
    ]
    own_ship = [RecordedMotion(float(stamp), np.zeros(4), 0.0) for stamp in times]
    results, dropped = process_recording(Recording(scans, own_ship), MOVING, "bow")
    assert len(results) == len(scans)
    assert dropped == {"echo_too_late": 1}
