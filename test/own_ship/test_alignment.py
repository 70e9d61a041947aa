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
"""The set-up that explains echoes of what stands is found with its error, or none is named."""

import math

import numpy as np
import pytest

from tsepm_ros.own_ship.alignment import (
    AS_IS,
    AZIMUTH_SCALE,
    CLOCK,
    KINDS,
    RANGE_SCALE,
    RIGHT,
    UNCLEAR,
    UNKNOWN,
    YAW,
    Looks,
)

PORT = 1j


def looks(
    seed=0,
    *,
    speed=0.7,
    turns=0.6,
    period=24.0,
    every=1.0,
    yaw=0.0,
    mirror=False,
    view=1.0,
    ranges=1.0,
    flipped=False,
    late=0.0,
    compass=False,
    mounting=0.0,
    down=False,
    depth=0.0,
    tilt=0.0,
    posts=12,
    boats=(),
    clutter=4,
    range_std=0.1,
    azimuth_std=0.01,
) -> Looks:
    """Echoes of posts, boats that keep their place beside own ship, and clutter, as stated.

    The sonar sees 1 rad to each side out to 40 m, and turns to and fro once in a period. Echoes are
    `depth` below it; it looks down by `tilt`.
    """
    rng = np.random.default_rng(seed)
    times = every * np.arange(40.0)

    def true(time):
        return speed * time * (1.0 + 0.1j), turns * np.sin(2.0 * math.pi * time / period)

    stand = rng.uniform(3.0, 60.0, posts) + PORT * rng.uniform(-25.0, 25.0, posts)
    columns = []
    for number, time in enumerate(times):
        place, heading = true(time)
        things = np.append(stand, place + np.asarray(boats, complex)) - place
        ahead = things * np.exp(-1j * (heading + mounting))
        inclined = math.cos(tilt) * ahead.real + math.sin(tilt) * depth + 1j * ahead.imag
        r = np.hypot(np.abs(ahead), depth) + range_std * rng.standard_normal(len(things))
        a = np.angle(inclined) + azimuth_std * rng.standard_normal(len(r))
        seen = (np.abs(a) < 1.0) & (r < 40.0) & (rng.random(len(r)) < 0.9)
        r = np.append(r[seen], 40.0 * np.sqrt(rng.random(clutter)))
        a = np.append(a[seen], rng.uniform(-1.0, 1.0, clutter))
        a = (-a if mirror else a) / view
        r = (40.0 - r if flipped else r) / ranges
        columns.append(np.stack([np.full(len(r), time), r, a, np.full(len(r), number)]))
    time, range_, azimuth, scan = np.concatenate(columns, axis=1)
    known = np.arange(-3.0, 44.0, 0.25)
    place, heading = true(known - late)
    heading = mounting + (0.5 * math.pi - heading if compass or down else heading - yaw)
    place = 1j * place.conj() if down else place
    errors = np.full((2, len(time)), [[range_std], [azimuth_std]])
    poses = np.stack([known, place.real, place.imag, heading])
    return Looks(time, range_, azimuth, *errors, scan.astype(int), 40.0, poses)


@pytest.mark.parametrize("seed", range(3))
def test_a_right_set_up_is_right(seed):
    assert looks(seed).explanation().kind == RIGHT
    assert looks(seed, turns=0.0).explanation().kind == RIGHT


@pytest.mark.parametrize("degrees", [-150, -45, 10, 25, 90, 180])
@pytest.mark.parametrize("turns", [0.0, 0.6])
def test_a_yaw_is_found_within_three_of_its_errors(degrees, turns):
    fit = looks(yaw=math.radians(degrees), turns=turns).explanation()
    assert fit.kind == "yaw"
    off = math.remainder(fit.off - math.radians(degrees), 2.0 * math.pi)
    assert abs(off) < min(3.0 * fit.error, math.radians(2.0))


def test_errors_of_a_yaw_are_as_stated():
    """Of 24 fits, the mean square of errors in stated ones is within 0.3 and 2 of chance's 1."""
    fits = [
        looks(seed, yaw=0.3).refined("yaw", AS_IS + 0.3 * np.eye(7)[YAW], YAW) for seed in range(24)
    ]
    assert 0.3 < np.mean([((fit.off - 0.3) / fit.error) ** 2 for fit in fits]) < 2.0


@pytest.mark.parametrize(
    ("wrong", "kind", "parameter", "value"),
    [
        ({"view": 2.0}, "azimuth_scale", AZIMUTH_SCALE, 2.0),
        ({"view": 0.5}, "azimuth_scale", AZIMUTH_SCALE, 0.5),
        ({"ranges": 2.0}, "range_scale", RANGE_SCALE, 2.0),
        ({"ranges": 0.5}, "range_scale", RANGE_SCALE, 0.5),
        ({"late": 0.5}, "clock", CLOCK, 0.5),
        ({"late": -0.5}, "clock", CLOCK, -0.5),
    ],
)
def test_scales_and_the_clock_are_found_with_their_values(wrong, kind, parameter, value):
    fit = looks(**wrong).explanation()
    assert fit.kind == kind
    assert fit.set_up[parameter] == pytest.approx(value, abs=max(3.0 * fit.error, 0.02))


@pytest.mark.parametrize(
    ("wrong", "kind"), [("mirror", "mirrored"), ("flipped", "reversed"), ("compass", "compass")]
)
def test_a_mirror_a_flip_and_a_clockwise_heading_are_told_apart(wrong, kind):
    assert looks(**{wrong: True}).explanation().kind == kind


@pytest.mark.parametrize("mounting", [-1.2, 0.0, 0.26])
def test_a_clockwise_heading_is_named_whatever_the_mounting_and_the_axes_of_positions(mounting):
    assert looks(compass=True, mounting=mounting).explanation().kind == "compass"
    kind = looks(down=True, mounting=mounting).explanation().kind
    assert kind == ("compass" if mounting else "mirrored")


TILTED = {"speed": 1.0, "turns": 0.33, "period": 70.0, "every": 0.5, "depth": 5.5, "tilt": 0.17}
"""A sonar that is tilted on a vessel that turns slowly, over things that stand on the bottom."""


@pytest.mark.parametrize("ranges", [0.97, 1.0, 1.03])
@pytest.mark.parametrize("seed", range(2))
def test_slant_ranges_a_tilt_and_a_small_scale_of_ranges_are_no_clock(seed, ranges):
    seen = looks(seed, posts=60, range_std=0.2, azimuth_std=0.005, ranges=ranges, **TILTED)
    assert seen.explanation().kind == RIGHT


def test_on_a_straight_course_a_mirror_shows_as_little_as_it_matters():
    course = math.atan(0.1)  # from which a heading of 0 differs, so that a mirror moves places
    assert looks(mirror=True, turns=0.0).explanation().kind in (RIGHT, UNKNOWN)
    assert looks(yaw=2.0 * course, turns=0.0).explanation().kind in ("yaw", UNKNOWN)


@pytest.mark.parametrize("turns", [0.0, 0.6])
def test_clutter_that_another_set_up_crowds_together_is_no_thing_that_stands(turns):
    clutter = {"posts": 0, "clutter": 30, "range_std": 0.6, "azimuth_std": 0.02, "turns": turns}
    kinds = [looks(seed, **clutter).explanation().kind for seed in range(2)]
    assert set(kinds) <= {RIGHT, UNCLEAR}


def test_two_errors_at_once_are_said_to_be_unknown():
    assert looks(flipped=True, yaw=0.7).explanation().kind in (UNKNOWN, "unclear")
    assert looks(yaw=0.7, view=2.0).explanation().kind in (UNKNOWN, "unclear")


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_boats_that_move_along_show_nothing_and_hide_nothing(yaw):
    boats = [10.0 + 4.0j, 14.0 - 6.0j, 18.0 + 2.0j, 20.0 - 3.0j, 24.0 + 9.0j, 28.0 - 8.0j, 30.0]
    assert looks(boats=boats, posts=0, yaw=yaw).explanation().kind == "unclear"
    assert looks(boats=boats, yaw=yaw).explanation().kind == ("yaw" if yaw else RIGHT)


@pytest.mark.parametrize("angle", [-0.35, 0.6])
def test_boats_in_line_are_not_lined_up_with_own_ships_way_by_a_yaw(angle):
    row = [(4.0 + 3.0 * number) * np.exp(1j * angle) for number in range(7)]
    assert looks(boats=row, posts=0, turns=0.0).explanation().kind == "unclear"


def test_an_estimate_at_the_end_of_what_was_tried_is_not_named():
    assert looks(ranges=6.0).explanation().kind not in {kind for kind, *_ in KINDS}
    assert looks(late=2.6).explanation().kind != "clock"


def test_a_sonar_that_only_turns_tells_nothing_of_yaw_and_ranges():
    for wrong in ({"yaw": 0.5}, {"ranges": 2.0}, {"flipped": True}, {"compass": True}):
        kind = looks(speed=0.0, **wrong).explanation().kind
        assert kind in (("mirrored",) if "compass" in wrong else (RIGHT, "unclear"))


@pytest.mark.parametrize("seed", range(4))
def test_a_vessel_at_rest_that_turns_once_is_right(seed):
    """What moves along with own ship is then what stands, and proves nothing of a set-up."""
    assert looks(seed, speed=0.0).explanation().kind == RIGHT
