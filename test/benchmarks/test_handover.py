"""The comparison of what a filter gets of a start's covariance: its figures, on small scenes."""

from __future__ import annotations

import handover
import numpy as np
import pytest
from handover import AHEAD, NEES_OF_STATE, POSITION, VARIANTS, VELOCITY, Followed, Scene

from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint, Outcome, simulate
from tsepm_ros.tools.simulation import load_scenario

FULL, BLOCKS, DOUBLED, DIAGONAL = range(len(VARIANTS))
A = np.random.default_rng(5).standard_normal((4, 4))
COVARIANCE = A @ A.T


def scene(**changes: float) -> Scene:
    given = {name.replace("__", "."): value for name, value in changes.items()}
    given |= {"scans": handover.SCANS + handover.AFTER}
    scenario = load_scenario("four_targets", given)
    return Scene.of(simulate(scenario, [3, 0], OperatingPoint("tsepm")))


@pytest.fixture(scope="module")
def followed() -> Followed:
    runs = [handover.follow((3, run), "tsepm", 0.0) for run in range(2)]
    return Followed.of(runs)


def test_blocks_are_without_what_is_between_position_and_velocity():
    position, velocity = [0, 2], [1, 3]
    given = VARIANTS["blocks"](COVARIANCE)
    for rows in (position, velocity):
        place = np.ix_(rows, rows)
        np.testing.assert_array_equal(given[place], COVARIANCE[place])
    assert not given[np.ix_(position, velocity)].any()
    assert not given[np.ix_(velocity, position)].any()


def test_doubled_blocks_exceed_any_covariance_that_they_may_be_of():
    assert np.linalg.eigvalsh(VARIANTS["doubled"](COVARIANCE) - COVARIANCE).min() > 0.0
    assert np.linalg.eigvalsh(VARIANTS["blocks"](COVARIANCE) - COVARIANCE).min() < 0.0


@pytest.mark.long
def test_at_the_start_all_have_the_start_s_errors(followed):
    at_start = followed.figures[:, :, 0]
    for figure in (POSITION, VELOCITY):
        assert (at_start[:, :, figure] == at_start[:, :1, figure]).all()
    np.testing.assert_allclose(at_start[:, BLOCKS, AHEAD], at_start[:, FULL, AHEAD])
    for figure in (AHEAD, NEES_OF_STATE):
        np.testing.assert_allclose(2.0 * at_start[:, DOUBLED, figure], at_start[:, BLOCKS, figure])


def test_the_start_s_figures_are_those_of_its_judgement():
    made = scene()
    judged = [one for one in made.run.judged() if one.outcome is Outcome.TRUE]
    figures = handover.follow((3, 0), "tsepm", 0.0).figures[:, FULL, 0]
    assert len(made.starts) == len(figures) <= len(judged)
    for one, figure in zip(judged, figures, strict=False):
        expected = (one.nees, one.position_error, one.velocity_error)
        np.testing.assert_allclose(figure[NEES_OF_STATE:], expected, rtol=1e-9)


def test_carried_ahead_a_start_is_where_constant_velocity_takes_it():
    made = scene()
    start = made.starts[0]
    target = handover.Target(start.track.state, start.track.covariance)
    figures = handover.predicted(made, start, target, 0.0)
    later = start.track.predicted(start.track.stamp + handover.AFTER * 12.0)
    error = later.position - made.truth(start, handover.AFTER)[0::2]
    expected = error @ np.linalg.solve(later.position_covariance, error)
    assert figures[-1] == pytest.approx(expected, rel=1e-9)


def test_without_clutter_nothing_false_is_taken_and_nothing_is_lost():
    made = scene(sensor__clutter_density=1e-12, sensor__detection_probability=1.0)
    false, lost = handover.in_clutter(made, VARIANTS["full"], 0.0)
    assert len(made.starts) == 4
    assert false == [0.0] * 4
    assert lost == [False] * 4


def test_targets_that_are_not_seen_any_more_are_lost():
    made = scene(sensor__clutter_density=1e-12, sensor__detection_probability=1.0)
    last = max(start.scan for start in made.starts)
    assert last < handover.AFTER - 1
    for index in range(last + 1, len(made.detections)):
        made.detections[index] = made.detections[index][:0]
    _, lost = handover.in_clutter(made, VARIANTS["full"], 0.0)
    assert lost == [True] * 4


def test_every_table_and_picture_is_made(followed, tmp_path):
    text = handover.tables(followed)
    assert all(title in text for title in handover.TITLES)
    assert "nan" not in text
    pytest.importorskip("matplotlib")
    handover.draw({"tsepm": followed}, tmp_path / "handover.png")
    assert (tmp_path / "handover.png").stat().st_size > 10_000
