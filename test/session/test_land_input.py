"""Charts that arrive at a session."""

from __future__ import annotations

import numpy as np
from support.sessions import arrived, moving, play, sail, session

from tsepm_ros import LandMask, Scan

AHEAD = LandMask(np.ones((10, 10)), 10.0, (2950.0, -50.0, 0.0))
"""Land where `ping` has its target."""
ASTERN = LandMask(np.ones((10, 10)), 10.0, (-2950.0, -50.0, 0.0))


def test_a_chart_in_another_frame_is_refused_and_the_former_stays():
    one = session()
    one.add_land(AHEAD, "sonar")
    play(one, [0])
    for frame in ("map", ""):
        one.add_land(ASTERN, frame)
        (result,) = play(one, [12.0 if frame else 24.0])
        assert result.statistics.on_land == 1
    assert one.dropped["land_frame"] == 2
    assert one.heard == ["land", "land_frame", "land_frame"]


def test_a_chart_is_of_the_fixed_frame_not_the_sensor_s():
    one = moving()
    sail(one, 0.0, 60.0)
    one.add_land(LandMask([[True]], 20.0, (990.0, 0.0, 0.0)), "odom")
    distance = np.hypot(1000.0, 0.0)
    one.add_scan(arrived(Scan(0.0, [distance], [-0.5])), 0.0)
    (result,) = one.process(0.0)
    assert result.statistics.on_land == 1


def test_a_reset_keeps_the_chart_for_its_frame():
    one = session()
    one.add_land(AHEAD, "sonar")
    play(one, [0])
    one.reset()
    (result,) = play(one, [0])
    assert result.statistics.on_land == 1
    one.reset()
    one.add_scan(arrived(Scan(0.0, [3000.0], [0.0]), "other"), 0.0)
    (result,) = one.process()
    assert result.statistics.on_land == 0
    assert one.dropped == {"land_frame": 1}


def test_a_restart_and_a_change_of_method_keep_the_chart():
    one = session()
    one.add_land(AHEAD, "sonar")
    results = play(one, [1000, 1012, 0, 12])
    assert [result.statistics.on_land for result in results] == [1] * 4
    one.configure(session(method="score").settings)
    (result,) = play(one, [24])
    assert result.statistics.on_land == 1


def test_a_chart_of_another_frame_that_comes_before_the_frame_is_refused_then():
    one = moving()
    one.add_land(AHEAD, "map")
    assert one.dropped == {}
    sail(one, 0.0, 60.0)
    play(one, [0, 12])
    assert one.dropped == {"land_frame": 1}
