"""Closest point of approach, and which targets meet."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tracker.maintenance.features import closest_approach, distance_at, meeting


def published(axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Ships A and B of Section 2.2, angles clockwise from north or counter-clockwise from east."""

    def ship(distance: float, bearing: float, speed: float, heading: float) -> np.ndarray:
        bearing, heading = np.deg2rad([bearing, heading])
        first, second = (np.sin, np.cos) if axis == "north" else (np.cos, np.sin)
        return np.array(
            [
                distance * first(bearing),
                speed * first(heading),
                distance * second(bearing),
                speed * second(heading),
            ]
        )

    return ship(18e3, 187.0, 6.0, 330.0), ship(17e3, 189.0, 4.0, 190.0)


def moved(state: np.ndarray, time: float) -> np.ndarray:
    return state + time * np.array([state[1], 0.0, state[3], 0.0])


@pytest.mark.parametrize("axis", ["north", "east"])
def test_the_published_ships_meet_whatever_the_angles_are_measured_from(axis):
    one, two = published(axis)
    found = minimize_scalar(
        lambda t: math.dist(moved(one, t)[[0, 2]], moved(two, t)[[0, 2]]), bounds=(-1e3, 1e3)
    )
    time, distance = closest_approach(one, two)
    assert time == pytest.approx(found.x, abs=0.01)
    assert distance == pytest.approx(found.fun, abs=1e-3)
    assert (time, distance) == (pytest.approx(122.7, abs=0.05), pytest.approx(188.5, abs=0.05))


def test_the_shipped_scenario_has_the_published_ships():
    targets = load_scenario("encounter").targets
    np.testing.assert_allclose(targets[:2], published("north"), atol=0.01)


def test_it_is_the_printed_equation_but_for_its_sign():
    rng = np.random.default_rng(3)
    for _ in range(100):
        one, two = rng.normal(0.0, [1e3, 5.0, 1e3, 5.0], (2, 4))
        (east, ve, north, vn) = two - one
        speeds = np.hypot(one[1], one[3]), np.hypot(two[1], two[3])
        headings = math.atan2(one[1], one[3]), math.atan2(two[1], two[3])
        relative = math.sqrt(  # Eq. 1
            speeds[1] ** 2
            + speeds[0] ** 2
            - 2.0 * speeds[1] * speeds[0] * math.cos(headings[0] - headings[1])
        )
        angle = math.hypot(east, north) * math.cos(math.atan2(ve, vn) - math.atan2(east, north))
        time, _ = closest_approach(one, two)
        assert abs(time) == pytest.approx(abs(angle) / relative)  # Eq. 9
        assert np.sign(time) == -np.sign(east * ve + north * vn), "above 0 while they approach"


def test_ships_on_one_course_are_closest_now():
    state = np.array([[0.0, 3.0, 0.0, 4.0], [30.0, 3.0, 40.0, 4.0]])
    assert closest_approach(*state) == (0.0, 50.0)


@pytest.mark.parametrize(
    ("within", "width", "met"),
    [(125.0, 188.6, True), (125.0, 188.4, False), (120.0, 190.3, True), (120.0, 190.2, False)],
)
def test_targets_meet_where_their_gates_overlap_in_time(within, width, met):
    # Two gates of half the width each, 3 standard deviations of the state's and the plot's error.
    states = np.stack(published("north"))
    spread = np.zeros((2, 4, 4))
    spread[:, [0, 2], [0, 2]] = 3.0**2
    error = math.sqrt((width / 6.0) ** 2 - 9.0)
    one, two = meeting(states, spread, np.full(2, error), 3.0, within)
    times = np.linspace(-within, within, 10_001)
    closest = distance_at(*states[:, None], times).min()
    assert (closest <= width) == met, "what the numbers above mean"
    assert (one.tolist(), two.tolist()) == (([0], [1]) if met else ([], []))


def test_targets_that_stay_side_by_side_meet_all_the_time():
    states = np.array([[0.0, 5.0, 0.0, 0.0], [0.0, 5.0, 50.0, 0.0], [0.0, 5.0, 500.0, 0.0]])
    one, two = meeting(states, np.zeros((3, 4, 4)), np.full(3, 10.0), 3.0, 60.0)
    assert (one.tolist(), two.tolist()) == ([0], [1])


def test_a_velocity_that_is_not_known_well_makes_them_meet_the_more():
    states = np.array([[0.0, 5.0, 0.0, 0.0], [600.0, -5.0, 200.0, 0.0]])
    spread = np.zeros((2, 4, 4))
    assert not len(meeting(states, spread, np.full(2, 10.0), 3.0, 60.0)[0])
    spread[:, 3, 3] = 1.0
    assert len(meeting(states, spread, np.full(2, 10.0), 3.0, 60.0)[0]) == 1
