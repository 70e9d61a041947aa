"""The initiator in a session: changed options and methods, failures, limits, what it imports."""

import dataclasses
import math
import subprocess
import sys

import numpy as np
import pytest
from support.builders import assert_same_tracks
from support.sessions import NotedSession, failing_at, held, play, play_empty, session, settings

from tsepm_ros import Scan, SensorModel
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.inputs import Arrival
from tsepm_ros.session.session import Session
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.method import ScanStatistics
from tsepm_ros.tracker.options import CommonOptions


@pytest.mark.internal_error
def test_a_scan_at_which_the_initiator_fails_forgets_the_tracks():
    one = NotedSession(failing_at(36.0, settings()))
    (track,) = play(one, [0, 12, 24])[2].new
    assert play(one, [36]) == []
    assert one.dropped == {"internal_error": 1}
    results = play(one, [48, 60, 72])
    assert (held(results[0]), results[0].ended) == ([], {track.track_id: "cleared"})
    assert len(results[2].new) == 1


def test_changed_times_and_limits_count_at_the_next_scan():
    one = session(CommonOptions(hold_time=1000.0))
    play(one, [0, 12, 24])
    one.configure(settings(CommonOptions(hold_time=5.0), restart_jump=10.0, max_gap=20.0))
    (result,) = play_empty(one, [36])
    assert result.ended == {0: "not_detected"}
    assert [result.arrival for result in play(one, [57, 40, 41])] == [
        Arrival.GAP,
        Arrival.RESTART,
        Arrival.NEXT,
    ]


def unusable_settings(**options) -> Settings:
    """Settings that pass all checks, and of which no initiator can be made."""
    sensor = SensorModel()
    object.__setattr__(sensor, "max_range", 0.0)  # as if its bound had been forgotten
    wanted = settings(CommonOptions(hold_time=1.0), TsepmOptions(min_hits=2, window=3), **options)
    return dataclasses.replace(wanted, sensor=sensor)


@pytest.mark.parametrize("method", ["tsepm", "score"])
@pytest.mark.parametrize("change", [Session.configure, Session.validate])
def test_a_change_that_fails_leaves_all_as_it_was(method, change):
    one, other = session(), session()
    play(one, [0, 12])
    play(other, [0, 12])
    before = one.settings
    with pytest.raises(ZeroDivisionError):
        change(one, unusable_settings(method=method, max_gap=5.0, restart_jump=1.0))
    assert one.settings is before
    found, expected = play(one, [24, 36, 22, 48]), play(other, [24, 36, 22, 48])
    assert [len(result.new) for result in expected] == [1, 0, 0]
    for a, b in zip(found, expected, strict=True):
        assert_same_tracks(a.new, b.new)
        assert_same_tracks(a.current, b.current)
        assert (a.arrival, a.ended) == (b.arrival, b.ended)
    assert one.dropped == other.dropped
    assert one.totals == other.totals


@pytest.mark.parametrize("method", ["tsepm", "score"])
def test_a_rehearsal_changes_nothing(method):
    one = session()
    play(one, [0, 12])
    one.validate(
        settings(CommonOptions(hold_time=1.0), TsepmOptions(min_hits=2, window=3), method=method)
    )
    assert [len(result.new) for result in play(one, [24])] == [1]
    (held,) = play_empty(one, [36])
    assert len(held.current) == 1


@pytest.mark.internal_error
def test_figures_count_on_through_restarts_failures_and_another_method():
    one = NotedSession(failing_at(36.0, settings()))
    play(one, [1000, 1012, 1024])
    play(one, [0, 12, 24, 36, 48])
    one.configure(settings(method="score"))
    play(one, [60])
    totals = one.figures().totals
    assert (totals.scans, totals.detections, totals.confirmed) == (8, 8, 2)
    one.reset()
    assert one.figures().totals == ScanStatistics()


@pytest.mark.parametrize("live", [False, True])
def test_the_time_limit_holds_only_live(live):
    one = Session(settings(max_scan_time=3.0), live=live)
    play(one, [0])
    assert one.tracker.max_scan_time == (3.0 if live else math.inf)
    one.configure(settings(max_scan_time=4.0))
    play(one, [12])
    assert one.tracker.max_scan_time == (4.0 if live else math.inf)


def fed(one: Session, scans) -> Session:
    for scan in scans:
        one.add_scan(SensorScan(scan, "sonar"), 0.0)
        list(one.process())
    return one


@pytest.mark.parametrize("used", ["given", "estimated"])
def test_the_reported_area_is_that_to_which_the_density_in_use_refers(used):
    """Clutter within a third of the range: a ninth of the coverage is seen."""
    one, rng = Session(settings(CommonOptions(clutter_density=used))), np.random.default_rng(1)
    sensor = one.tracker.sensor
    fed(
        one,
        (
            Scan(
                12.0 * index,
                sensor.max_range / 3.0 * np.sqrt(rng.random(60)),
                rng.uniform(-3.1, 3.1, 60),
            )
            for index in range(10)
        ),
    )
    figures = one.figures()
    share = figures.coverage_area / sensor.coverage_area
    assert share == pytest.approx(1.0 if used == "given" else 1.0 / 9.0, rel=0.1)
    if used == "given":
        assert figures.clutter_density == sensor.clutter_density


@pytest.mark.parametrize(("most", "said"), [(100, False), (5, True)])
def test_hypotheses_that_a_limit_cuts_are_noticed(most, said):
    rng, sentences = np.random.default_rng(1), []
    one = Session(
        settings(CommonOptions(max_potential_tracks=most)),
        lambda reason, sentence: sentences.append(sentence),
    )
    fed(one, [Scan(12.0, rng.uniform(500.0, 5000.0, 20), rng.uniform(-3.0, 3.0, 20))])
    assert ("a limit cut 15 hypotheses at 12.000 s" in sentences) is said


def test_a_notice_says_once_that_strengths_count_and_that_they_no_longer_do():
    rng, said = np.random.default_rng(1), []
    one = Session(settings(method="score"), lambda *one: said.append(one))
    found = []
    for index in range(8):
        range_, azimuth = rng.uniform(500.0, 5000.0, 40), rng.uniform(-3.0, 3.0, 40)
        features = {"intensity": rng.exponential(size=40)} if index < 5 else {}
        fed(one, [Scan(12.0 * index, range_, azimuth, features=features)])
        found += [(index, sentence) for subject, sentence in said if subject == "intensity"]
        said.clear()
    assert [index for index, _ in found] == [1, 5]
    assert "used: compared with" in found[0][1] and "no strengths" in found[1][1]
    assert one.figures().intensity == "not used: no strengths"


HEAVY = "scipy.stats", "scipy.ndimage", "scipy.optimize", "matplotlib", "rclpy"


def test_a_session_with_every_method_imports_no_heavy_module_that_it_does_not_use():
    code = (
        "import sys, tsepm_ros.session.session, tsepm_ros.methods.registry; "
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
