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
"""What recurs falls together in the fixed frame, or what is set up wrong is said."""

import math
import re

import numpy as np
import pytest
from support.sessions import arrived

from tsepm_ros import Scan, SensorModel
from tsepm_ros.own_ship.alignment import AS_IS, CLOCK, Fit
from tsepm_ros.own_ship.pose_history import PoseHistory, PoseSample
from tsepm_ros.own_ship.registration import Mounting, register_in_fixed_frame
from tsepm_ros.session.registration_check import RegistrationCheck

SENSOR = SensorModel(
    range_std=0.1,
    range_std_fraction=0.0,
    azimuth_std=0.008,
    min_range=0.5,
    max_range=40.0,
    azimuth_min=-1.0,
    azimuth_max=1.0,
)
TURN = math.radians(5.0)


def way(time: float, *, turns: bool, speed: float) -> tuple[float, float, float]:
    """A vessel that turns to and fro by 30 degrees, with rests between."""
    phase = time % 24.0
    yaw = TURN * (np.clip(phase - 4.0, 0.0, 6.0) - np.clip(phase - 16.0, 0.0, 6.0)) * turns
    return speed * time, 0.1 * speed * time, float(yaw)


def notes(
    wrong: str = "",
    *,
    turns=True,
    speed=0.3,
    standing=10,
    seconds=60.0,
    late=0.0,
    delay=0.0,
    mended=math.inf,
    findings=None,
    every=0,
) -> list[str]:
    """Sentences about the registration of a sonar among things that stand, and of clutter."""
    rng, said = np.random.default_rng(3), []
    check, poses = RegistrationCheck(delay), PoseHistory(max_extrapolation=1.0)
    findings = [] if findings is None else findings
    things = np.column_stack([rng.uniform(3.0, 45.0, standing), rng.uniform(-25, 25, standing)])
    sent, held = 0.0, []
    for time in np.arange(1.0, seconds, 0.25):
        while sent < time + 0.8:
            x, y, yaw = way(sent, turns=turns, speed=speed)
            sign = -1.0 if wrong == "north, east, down" else 1.0
            yaw -= 0.3 * (wrong == "yaw" and sent < mended)
            held.append(PoseSample(sent + late - delay, x, sign * y, sign * yaw))
            if not every or len(held) > 1 or round(10.0 * sent) % every:
                while held:
                    poses.add(held.pop())  # of two, the later one first
            sent += 0.1
        x, y, yaw = way(time, turns=turns, speed=speed)
        east, north = (things - (x, y)).T
        range_ = np.hypot(east, north) + 0.1 * rng.standard_normal(standing)
        azimuth = np.arctan2(north, east) - yaw + 0.008 * rng.standard_normal(standing)
        seen = (range_ < 40.0) & (np.abs(azimuth) < 1.0) & (rng.random(standing) < 0.9)
        range_ = np.append(range_[seen], 40.0 * np.sqrt(rng.random(4))).clip(0.5)
        azimuth = np.append(azimuth[seen], rng.uniform(-1.0, 1.0, 4))
        if wrong == "mirrored" and time < mended:
            azimuth = -azimuth
        elif wrong == "reversed":
            range_ = 40.5 - range_
        scan = arrived(Scan(float(time), range_, azimuth))
        registered = register_in_fixed_frame(scan, poses, Mounting())
        said += check.take(scan, registered, SENSOR, Mounting(), poses)
        findings.append(check.finding)
    return [notice.sentence for notice in said]


def test_a_right_set_up_is_silent():
    assert notes() == []
    assert notes(turns=False) == []


def test_azimuths_that_are_clockwise_are_said_with_the_remedy():
    (said,) = notes("mirrored", speed=0.0)
    assert "clockwise" in said
    assert "field bearing" in said
    assert "image.port_first" in said


def test_a_finding_lasts_until_it_is_mended_and_is_said_once():
    findings: list[str] = []
    assert len(notes("mirrored", speed=0.0, seconds=160.0, mended=80.0, findings=findings)) == 1
    begin = next(index for index, said in enumerate(findings) if said)
    assert all("clockwise" in said for said in findings[begin : 4 * 79])
    assert findings[-1] == ""


def test_own_ship_in_axes_north_east_and_down_is_a_mirror_whose_remedy_names_it():
    (said,) = notes("north, east, down")
    assert "heading is clockwise" in said and "NED" in said


def test_ranges_from_the_far_end_are_said_once_the_sensor_has_moved():
    (said,) = notes("reversed")
    assert "image.near_first" in said
    assert notes("reversed", speed=0.0) == []


@pytest.mark.parametrize("late", [0.4, -0.4])
def test_a_clock_of_own_ship_is_said_with_its_shift_and_following_it_silences_the_note(late):
    (said,) = notes(late=late)
    shift, error = map(float, re.search(r"is ([\d.]+) \+- ([\d.]+) s", said).groups())
    assert shift == pytest.approx(abs(late), abs=0.08)
    assert error < 0.08
    assert ("late" if late > 0.0 else "early") in said
    remedy = float(re.search(r"own_ship_delay (-?[\d.]+)", said)[1])
    assert notes(late=late, delay=remedy) == []


@pytest.mark.parametrize("late", [0.0, 0.4])
def test_nothing_is_said_where_nothing_stands(late):
    assert notes(late=late, standing=0) == []


def test_nothing_is_said_where_the_vessel_neither_turns_nor_moves():
    assert notes("mirrored", turns=False, speed=0.0) == []
    assert notes(late=0.4, turns=False, speed=0.0) == []


@pytest.mark.parametrize("every", [0, 10])
def test_a_yaw_is_said_with_what_to_give_and_ends_within_a_minute_of_its_mending(every):
    """Also where one pose in ten comes after the next."""
    findings: list[str] = []
    (said,) = notes("yaw", seconds=130.0, mended=70.0, findings=findings, every=every)
    remedy, error = map(float, re.search(r"mounting.yaw ([-\d.]+) \+- ([\d.]+)", said).groups())
    assert abs(remedy - 0.3) < 3.0 * error
    assert error < math.radians(2.0)
    assert "mounting.yaw" in findings[4 * 68]
    assert findings[-1] == ""


def test_a_figure_is_said_again_once_it_has_changed_by_more_than_its_error():
    check, said = RegistrationCheck(0.0), []
    for late in (0.34, 0.36, 0.5, 0.52):
        set_up = AS_IS + late * np.eye(7)[CLOCK]
        said += check._say(Fit("clock", set_up, CLOCK, 0.02, np.zeros(0)), Mounting())
    first, again = [notice.sentence for notice in said]
    assert "0.34 +- 0.05 s late" in first and "0.50 +- 0.05 s late" in again
    assert check.finding == again
