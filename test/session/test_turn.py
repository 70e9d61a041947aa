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
"""Turns of a beam: how they are learned, joined to images, and which messages are left out."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections import Counter

import numpy as np
import pytest
from support.sweeps import beam

from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.drop_reasons import DROP_REASONS
from tsepm_ros.session.turn import MOST_BYTES, ImagePing, ImageTurns, TurnLearner, TurnRound
from tsepm_ros.tools.simulation import Simulator, load_scenario, shipped_scenarios
from tsepm_ros.tracker.scan import ScanArc, scan_arc_of

CELLS = np.linspace(1.0, 5.0, 5)


def bearing(stamp, azimuth, level, cells=CELLS):
    azimuths = np.atleast_1d(np.array(azimuth, float))
    table = np.full((len(azimuths), len(cells)), float(level))
    return ImagePing(round(stamp * 1e9), "sonar", cells, azimuths, table, is_part=True)


def turned(turns, number, steps, seconds=2.0, begin=0.3, direction=1.0):
    """Pings of a beam that turns; intensities count its steps, from 1 on."""
    made = []
    for step in range(number * steps):
        angle = begin + direction * 2.0 * math.pi * step / steps
        azimuth = (angle + math.pi) % (2.0 * math.pi) - math.pi
        made += turns.add(bearing(seconds * step / steps, azimuth, step + 1))
    return made


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("seconds", [0.5, 2.9, 30.0])
def test_the_bearings_of_each_turn_are_one_ping_on_even_azimuths(direction, seconds):
    pings = turned(ImageTurns(), 4, 40, seconds, direction=direction)
    assert len(pings) == 3, "the first turn is used once it has shown its time, the last is open"
    for ping in pings:
        assert ping.intensity.shape == (40, 5)
        assert np.isfinite(ping.intensity).all()
        assert not ping.is_part
        np.testing.assert_allclose(np.diff(ping.azimuth), 2.0 * math.pi / 40)
        # Each bearing is where the beam was, at its own time.
        step = ping.intensity[:, 0] - 1
        angle = 0.3 + direction * 2.0 * math.pi * step / 40
        assert np.abs(np.angle(np.exp(1j * (ping.azimuth - angle)))).max() < 1e-4
        stamp = 1e-9 * ping.stamp_ns + ping.time_offset
        np.testing.assert_allclose(stamp, seconds * step / 40, atol=1e-6)


def test_a_missing_bearing_is_not_measured():
    turns, pings = ImageTurns(), []
    for step in range(160):
        if step != 100:
            azimuth = (2.0 * math.pi * step / 40 + math.pi) % (2.0 * math.pi) - math.pi
            pings += turns.add(bearing(0.05 * step, azimuth, 1.0))
    lost = [np.isnan(ping.intensity).all(axis=1).sum() for ping in pings]
    assert sorted(lost) == [0] * (len(pings) - 1) + [1]
    assert {len(ping.azimuth) for ping in pings} == {40}


def test_passes_over_a_sector_and_sectors_of_spokes_are_pings_of_equal_size():
    turns, pings = ImageTurns(), []
    there = np.linspace(-0.6, 0.6, 25)
    for step, azimuth in enumerate(np.concatenate([there, there[::-1]] * 4)):
        pings += turns.add(bearing(0.1 * step, azimuth, 1.0))
    assert len(pings) >= 4
    assert {ping.intensity.shape for ping in pings[1:]} == {(25, 5)}
    for ping in pings[1:]:
        assert ping.azimuth[[0, -1]] == pytest.approx([-0.6, 0.6], abs=0.06)
    turns, pings = ImageTurns(), []
    for part in range(64):
        start = 2.0 * math.pi * part / 16
        azimuth = start + 2.0 * math.pi / 256 * np.arange(16)
        azimuth = azimuth - 2.0 * math.pi * np.floor((start + math.pi) / (2.0 * math.pi))
        pings += turns.add(bearing(0.15 * part, azimuth, 1.0))
    assert {ping.intensity.shape for ping in pings} == {(256, 5)}
    assert all(np.isfinite(ping.intensity).all() for ping in pings)


def test_a_whole_ping_passes():
    ping = ImagePing(0, "sonar", CELLS, np.array([0.0, 0.1]), np.ones((2, 5)))
    assert ImageTurns().add(ping) == [ping]


STEPS, PAUSE = 60, 0.05


class Head:
    """Messages of a head that turns, or goes to and fro over a sector, with noise."""

    def __init__(self, sector: float, beams: int = 1, pause: float = PAUSE) -> None:
        self.sector, self.beams, self.pause = sector, beams, pause
        self.rng = np.random.default_rng(4)
        self.range = np.linspace(1.0, 50.0, 8)

    def message(self, number: int, *, later: float = 0.0, aside: float = 0.0) -> ImagePing:
        """The message at a place, its stamp later by some messages, and its azimuth aside."""
        place = number % STEPS
        if self.sector < 6.0 and number // STEPS % 2:
            place = STEPS - 1 - place
        step = self.sector / STEPS
        azimuth = math.remainder(step * place, 2.0 * math.pi) + aside
        return ImagePing(
            round(1e9 * (1000.0 + self.pause * (number + later))),
            "sonar",
            self.range,
            azimuth + step / self.beams * np.arange(self.beams),
            self.rng.integers(0, 255, (self.beams, 8)),
            is_part=True,
        )


def ahead(head, n):
    return [head.message(n, later=1e5)]


def a_little_ahead(head, n):
    return [head.message(n, later=8.0)]


def back(head, n):
    return [head.message(n, later=-20.0)]


def a_little_back(head, n):
    return [head.message(n, later=-1.2)]


def another_range(head, n):
    return [dataclasses.replace(head.message(n), range=0.98 * head.range)]


def another_frame(head, n):
    return [dataclasses.replace(head.message(n), frame_id="radar")]


def swapped(head, n):
    return [head.message(n, later=0.9), head.message(n - 1, later=0.1)]


def no_stamp(head, n):
    return [dataclasses.replace(head.message(n), stamp_ns=0)]


def lost(head, n):
    return []


def aside(head, n):
    return [head.message(n, aside=1.0)]


def twice(head, n):
    return [head.message(n)] * 2


def twice_later(head, n):
    return [head.message(n), head.message(n, later=0.5)]


GLITCHES = {
    ahead: "bearing_stamp",
    a_little_ahead: "bearing_stamp",
    back: "bearing_stamp",
    a_little_back: None,
    another_range: "bearing_geometry",
    another_frame: "bearing_geometry",
    swapped: None,
    no_stamp: "stamp_not_set",
    lost: None,
    aside: "bearing_azimuth",
    twice: "image_repeated",
    twice_later: None,
}

HEADS = {
    "turns": lambda: Head(2.0 * math.pi),
    "to and fro": lambda: Head(1.5),
    "spokes": lambda: Head(2.0 * math.pi, beams=8),
    "slow": lambda: Head(2.0 * math.pi, pause=12.0),
}


def images_of(head, glitches, *, share=0.05, number=5 * STEPS, seed=1):
    """Images, and counts of what was left out, of a run with some odd messages."""
    dropped, rng = Counter(), np.random.default_rng(seed)
    turns, images, sent = ImageTurns(lambda reason, _: dropped.update([reason])), [], 0
    for place in range(number):
        odd = glitches and rng.random() < share
        kind = glitches[rng.integers(len(glitches))] if odd else lambda head, n: [head.message(n)]
        for message in kind(head, place):
            sent += 1
            images += turns.add(message)
    assert set(dropped) <= set(DROP_REASONS)
    return images, dropped, turns, sent


CASES = [(one, head) for one in GLITCHES for head in ("turns", "to and fro")]

CASES += [("mixed", head) for head in HEADS]


@functools.cache
def clean_images(head):
    images, dropped, _, _ = images_of(HEADS[head](), [])
    assert dropped == {}
    return images


@pytest.mark.parametrize(("glitch", "head"), CASES, ids=lambda one: getattr(one, "__name__", one))
def test_odd_messages_cost_no_image_and_are_counted_by_their_reason(glitch, head):
    clean = clean_images(head)
    glitches = [*GLITCHES] if glitch == "mixed" else [glitch]
    images, dropped, _, _ = images_of(HEADS[head](), glitches)
    assert len(images) >= 0.8 * len(clean)
    assert {len(image.azimuth) for image in images} == {len(clean[0].azimuth)}
    assert np.mean([np.isfinite(image.intensity).mean() for image in images]) > 0.9
    for image in images:  # no odd stamp is in an image
        assert np.ptp(image.time_offset) < 1.2 * STEPS * HEADS[head]().pause
    if glitch != "mixed":
        assert (GLITCHES[glitch] is None) or dropped[GLITCHES[glitch]] >= 0.8 * dropped.total() > 3


@pytest.mark.parametrize("jitter", [0.3, 0.7])
def test_stamps_that_tremble_or_come_in_groups_cost_no_image(jitter):
    rng, turns, images = np.random.default_rng(2), ImageTurns(), []
    head = Head(2.0 * math.pi)
    for number in range(6 * STEPS):
        images += turns.add(head.message(number, later=jitter * rng.uniform(-1.0, 1.0)))
    assert len(images) == 5
    turns, images = ImageTurns(), []
    for number in range(6 * STEPS):
        images += turns.add(head.message(number, later=-float(number % 4)))
    assert len(images) == 5


@pytest.mark.parametrize("head", HEADS)
def test_a_head_that_starts_again_and_a_range_that_stays_begin_a_turn_and_nothing_is_learned_anew(
    head,
):
    driver, turns, images = HEADS[head](), ImageTurns(), []
    for number in range(10 * STEPS + STEPS // 3):
        if number == 4 * STEPS + STEPS // 3:
            driver.range = 0.6 * driver.range
        begins = STEPS * 7 + STEPS // 3
        at = number if number < begins else number - STEPS // 3
        images += turns.add(
            dataclasses.replace(driver.message(at), stamp_ns=driver.message(number).stamp_ns)
        )
        assert (number < 3 * STEPS) or not turns.state
    assert len(images) >= 8
    assert {image.range[-1] for image in images[-4:]} == {30.0}


@pytest.mark.parametrize(
    "is_other",
    [
        lambda place: place % 4 == 0,
        lambda place: place >= STEPS // 2,
        lambda place: place < STEPS // 4,
    ],
    ids=["every fourth", "half a turn", "first quarter"],
)
def test_of_ranges_that_differ_within_a_turn_that_is_used_which_is_met_most(is_other):
    dropped = Counter()
    turns, images = ImageTurns(lambda reason, _: dropped.update([reason])), []
    head = Head(2.0 * math.pi, beams=2)
    for number in range(8 * STEPS):
        message = head.message(number)
        other = dataclasses.replace(message, range=0.5 * head.range)
        images += turns.add(other if is_other(number % STEPS) else message)
    assert len(images) >= 6
    others = sum(map(is_other, range(STEPS))) / STEPS
    if others < 0.5:
        assert {image.range[-1] for image in images[-5:]} == {50.0}
    assert len({image.range[-1] for image in images[1:]}) == 1, "one range"
    assert set(dropped) == {"bearing_geometry"} and turns.state == ""
    for image in images[-5:]:
        measured = np.isfinite(image.intensity).all(axis=1)
        cells = round(2.0 * math.pi / np.diff(image.azimuth).mean())
        assert measured.sum() / cells == pytest.approx(1.0 - others, abs=0.1)


@pytest.mark.parametrize("first", [0, 3 * STEPS])
def test_without_stamps_no_image_is_made_and_why_is_said(first):
    dropped = Counter()
    turns, head = ImageTurns(lambda reason, _: dropped.update([reason])), Head(2.0 * math.pi)
    for number in range(8 * STEPS):
        message = head.message(number)
        turns.add(dataclasses.replace(message, stamp_ns=0) if number >= first else message)
    assert dropped["stamp_not_set"] >= 5 * STEPS - 2
    assert "stamp_not_set" in turns.state


def test_before_a_turn_is_known_the_state_says_why():
    turns, head = ImageTurns(), Head(2.0 * math.pi)
    assert turns.state == ""
    for number in range(10):
        turns.add(head.message(0, later=float(number)))
    assert turns.state == "bearings, but no turn, because the beam stands"
    for number in range(3 * STEPS):
        turns.add(head.message(10, later=float(number)))
        turns.add(head.message(11, later=-float(number)))
    assert turns.state.startswith("bearings, but no turn, because ")
    for number in range(1000, 1000 + 12 * STEPS):
        turns.add(head.message(number))
    assert turns.state == ""


def test_messages_of_two_drivers_after_images_are_no_turn():
    turns, heads, images = ImageTurns(), [Head(2.0 * math.pi) for _ in range(2)], []
    for number in range(2 * STEPS):
        images += turns.add(heads[0].message(number))
    assert images
    for burst in range(2 * STEPS, 10 * STEPS, 6):
        for head, ahead in zip(heads, (0, 13), strict=True):
            for number in range(burst + ahead, burst + ahead + 6):
                images += turns.add(head.message(number, later=0.5 - ahead))
    assert len(images) <= 2
    assert turns.state.startswith("bearings, but no turn, because their azimuths do not advance")


def test_a_beam_that_trembles_is_no_turn_and_one_that_turns_later_is():
    turns, head, images = ImageTurns(), Head(2.0 * math.pi), []
    for number in range(2 * STEPS):
        assert turns.add(head.message(number % 2, later=number - number % 2)) == []
    assert turns.state.startswith("bearings, but no turn, because ")
    for number in range(2 * STEPS, 9 * STEPS):
        images += turns.add(head.message(number))
    assert len(images) >= 3


@pytest.mark.parametrize("is_new", [True, False])
def test_what_waits_is_bounded_where_the_beam_or_its_stamps_stand(is_new):
    """A learned beam that stands, and one whose stamps stand: all is counted or waits."""
    dropped, head = Counter(), Head(2.0 * math.pi, beams=4)
    turns = ImageTurns(lambda reason, _: dropped.update([reason]))
    images = [one for number in range(4 * STEPS) for one in turns.add(head.message(number))]
    large = np.zeros((4, 200_000), np.uint8)
    head.range = np.linspace(1.0, 50.0, 200_000)
    sent = 4 * STEPS
    for number in range(sent, sent + 200):
        at = head.message(sent if is_new else number)
        large = np.array(large)
        large[0, number % 100] += 1
        stamped = dataclasses.replace(at, stamp_ns=round(1e9 * 1020.0), intensity=large)
        assert turns.add(stamped) == []
    waiting = turns._parts
    assert sum(one.intensity.nbytes + one.range.nbytes for one in waiting) <= 1.1 * MOST_BYTES
    in_images = sum(np.isfinite(image.intensity).all(axis=1).sum() for image in images) // 4
    assert dropped.total() + turns.unused + len(waiting) + in_images >= sent + 200 - 1


def test_a_message_with_a_wrong_increment_and_a_message_all_round_are_left_out():
    dropped, head, images = Counter(), Head(2.0 * math.pi, beams=8), []
    turns = ImageTurns(lambda reason, _: dropped.update([reason]))
    for number in range(6 * STEPS):
        message = head.message(number)
        factor = {5: 3.0, 130: -1.0, 200: 90.0}.get(number, 1.0)
        azimuth = message.azimuth[0] + factor * (message.azimuth - message.azimuth[0])
        images += turns.add(dataclasses.replace(message, azimuth=azimuth))
    assert dropped == {"bearing_geometry": 3}
    assert len(images) == 5


def sectors(passes: int, *, by_time: bool, odd: int = -1):
    """Messages of 5 bearings of a head to and fro, by time or to port; one may be mirrored."""
    rng, there = np.random.default_rng(3), 0.03 * np.arange(50).reshape(10, 5)
    for number in range(10 * passes):
        back = number // 10 % 2
        azimuth, sent = there[9 - number % 10 if back else number % 10], 0.1 * np.arange(5)
        way = -1 if back and by_time else 1
        azimuth, sent = azimuth[::way], sent if by_time or not back else sent[::-1]
        azimuth = 2.0 * azimuth[0] - azimuth if number == odd else azimuth
        yield ImagePing(
            round(1e9 * (1000.0 + 0.5 * number)),
            "sonar",
            CELLS,
            azimuth,
            rng.random((5, 5)),
            time_offset=sent,
            is_part=True,
        )


@pytest.mark.parametrize("by_time", [True, False], ids=["in the order of time", "to port"])
def test_each_pass_of_messages_of_several_bearings_is_an_image_without_a_loss(by_time):
    dropped = Counter()
    turns = ImageTurns(lambda reason, _: dropped.update([reason]))
    images = [image for message in sectors(12, by_time=by_time) for image in turns.add(message)]
    assert (len(images), dropped, turns.state) == (11, {}, "")
    for image in images:
        assert image.intensity.shape == (50, 5)
        assert np.isfinite(image.intensity).all()


def test_a_message_whose_bearings_run_against_the_beam_is_of_another_geometry():
    dropped = Counter()
    turns = ImageTurns(lambda reason, _: dropped.update([reason]))
    images = [
        image for message in sectors(12, by_time=True, odd=65) for image in turns.add(message)
    ]
    assert (len(images), dropped) == (11, {"bearing_geometry": 1})


def test_bearings_of_a_turn_that_repeat_the_turn_before_are_counted():
    dropped, head = Counter(), Head(2.0 * math.pi)
    turns = ImageTurns(lambda reason, _: dropped.update([reason]))
    made = [head.message(number) for number in range(6 * STEPS)]
    for number, message in enumerate(made):
        if number >= 2 * STEPS and number % STEPS < 20:
            made[number] = dataclasses.replace(message, intensity=made[number - STEPS].intensity)
    images = [image for message in made for image in turns.add(message)]
    assert (len(images), dropped) == (5, {"bearing_repeated": 3})
    assert np.isnan(images[-1].intensity).all(axis=1).sum() == 20


@pytest.mark.parametrize("parts", [2, 3])
def test_of_sectors_that_are_too_wide_to_be_joined_their_distance_is_said(parts):
    turns, rng = ImageTurns(), np.random.default_rng(1)
    for number in range(20):
        azimuth = 2.0 * math.pi / parts * (number % parts + np.arange(30) / 30) - math.pi
        values = rng.random((30, 5))
        ping = ImagePing(number * 10**9, "sonar", CELLS, azimuth, values, is_part=True)
        assert turns.add(ping) == []
    assert turns.state == (
        f"bearings, but no turn, because messages are {360 // parts} degrees apart, and a turn "
        "is joined of 4 or more, at most 90 degrees apart"
    )


def test_before_an_image_it_is_said_whether_messages_are_few_or_differ():
    turns, head = ImageTurns(), Head(2.0 * math.pi)
    for number in range(STEPS // 2):
        turns.add(head.message(number))
    assert turns.state.endswith("because less than a turn, or two passes alike, has come")
    turns = ImageTurns()
    for number in range(3 * STEPS):
        message = head.message(number)
        turns.add(dataclasses.replace(message, range=(1.0 + 0.01 * number) * head.range))
    assert turns.state.endswith("because they differ in their ranges, frame or angle increment")


def test_odd_messages_among_those_that_begin_a_turn_do_not_begin_it_again_without_end():
    _, _, turns, _ = images_of(HEADS["turns"](), [*GLITCHES], share=0.4, number=480, seed=34)
    assert turns.state.startswith("bearings, but no turn")


@pytest.mark.parametrize(
    ("part", "is_like"), [(1.0, True), (0.85, True), (0.75, False)], ids=["whole", "most", "less"]
)
def test_a_turn_is_like_another_of_which_no_more_than_a_fifth_lacks(part, is_like):
    step = 2.0 * math.pi / 60
    whole = TurnRound([], -math.pi, math.pi - step, step)
    other = TurnRound([], 0.0, part * 2.0 * math.pi, step)
    assert whole.is_like(other, step) is is_like
    assert not TurnRound([], -1.0, 1.0, step).is_like(whole, step), "a pass is not like a turn"


def pictures(*levels):
    """Which of some whole images are used, and what is said."""
    dropped, said = Counter(), []
    turns = ImageTurns(lambda reason, _: dropped.update([reason]), said.append)
    azimuth, used = np.linspace(-0.5, 0.5, 3), []
    for number, level in enumerate(levels):
        table = np.arange(15.0).reshape(3, 5) * level
        used += [
            number for _ in turns.add(ImagePing(number * 10**8, "sonar", CELLS, azimuth, table))
        ]
    return used, dropped, said


def test_an_image_that_is_equal_to_the_last_to_the_bit_is_left_out_and_counted():
    used, dropped, _ = pictures(1, 1, 2, 2, 3, 3, 3, 4)
    assert (used, dropped) == ([0, 2, 4, 7], {"image_repeated": 4})
    used, dropped, _ = pictures(1, 2, *[3] * 50)
    assert used == [0, 1, 2], "a driver that has stopped"
    used, dropped, _ = pictures(1, 0, 0, 0, 1)
    assert (used, dropped) == ([0, 1, 2, 3, 4], {}), "an image that shows nothing has no echo"


def test_a_source_whose_images_are_all_equal_goes_on_and_is_said():
    used, dropped, said = pictures(*[1] * 20)
    assert (len(used), dropped.total(), len({*said})) == (17, 3, 1)
    assert "source without noise" in said[0]


def images_with_runs(runs, *, levels=256, images=12):
    """Which bearings of some images are left out, where runs repeat the image before."""
    rng, dropped, before, left_out = np.random.default_rng(2), Counter(), None, []
    turns = ImageTurns(lambda reason, _: dropped.update([reason]))
    azimuth = np.linspace(-0.5, 0.5, 64)
    for k in range(images):
        table = (levels * rng.random((64, 40)) ** 8).astype(np.uint8)
        for first, last in runs if k > 1 else ():
            table[first:last] = before[first:last]
        before = table
        (ping,) = turns.add(ImagePing(k * 10**8, "sonar", np.arange(1.0, 41.0), azimuth, table))
        left_out.append(np.flatnonzero(np.isnan(np.asarray(ping.intensity, float)).all(axis=1)))
    return left_out, dropped


def test_bearings_that_repeat_the_image_before_are_counted_and_not_used():
    left_out, dropped = images_with_runs([(10, 30)])
    assert dropped == {"bearing_repeated": 10}
    assert [found.tolist() for found in left_out] == [[], [], *[list(range(10, 30))] * 10]


@pytest.mark.parametrize("levels", [1, 2, 4, 256])
def test_bearings_that_are_equal_by_nature_are_used(levels):
    left_out, dropped = images_with_runs([], levels=levels, images=30)
    assert dropped.total() == sum(map(len, left_out)) == 0


def test_a_driver_that_repeats_its_last_turn_is_of_this_kind():
    dropped, head, images = Counter(), Head(2.0 * math.pi), []
    turns = ImageTurns(lambda reason, _: dropped.update([reason]))
    first = [head.message(number) for number in range(3 * STEPS)]
    for number in range(8 * STEPS):
        same = first[number] if number < 2 * STEPS else first[STEPS + number % STEPS]
        images += turns.add(dataclasses.replace(same, stamp_ns=head.message(number).stamp_ns))
    assert (len(images), dropped) == (2, {"image_repeated": 5})


def test_a_turn_of_many_bearings_is_learned_within_its_time():
    head, turns = Head(2.0 * math.pi), ImageTurns()
    rng = np.random.default_rng(1)
    for number in range(1200):
        azimuth = math.remainder(2.0 * math.pi * number / 1000, 2.0 * math.pi)
        ping = dataclasses.replace(
            head.message(number), azimuth=np.array([azimuth]), intensity=rng.random((1, 8))
        )
        if turns.add(ping):
            break
    assert 990 < number < 1101


def learned(messages):
    """Number of messages until a sweep is seen, and its seconds; None if it is never."""
    learner = TurnLearner()
    for number, message in enumerate(messages):
        turning = learner.take(message.scan.stamp, message.beams, message.scan.range)
        if turning is not None:
            return number, turning[0]
    return None


def echoes(stamp: float, azimuth, range) -> UnregisteredScan:
    """A message that lists its detections only."""
    scan = Scan(stamp, range, azimuth)
    return UnregisteredScan(scan, "sonar", beams=scan_arc_of(scan.azimuth))


def turning(steps: float, direction: int = 1, *, whole: bool = True, seed: int = 0, share=1.0):
    rng = np.random.default_rng(seed)
    for number in range(int(4 * steps)):
        azimuth = math.remainder(direction * number * 2 * math.pi / steps, 2 * math.pi)
        if whole:
            yield beam(2.5 * number / steps, azimuth)
        elif rng.random() < share:
            yield beam(2.5 * number / steps, azimuth, rng.uniform(10.0, 900.0), whole=False)
        else:
            yield beam(2.5 * number / steps, None)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("steps", [8, 36, 400, 4096])
def test_a_turning_beam_is_a_sweep_after_a_turn(steps, direction):
    number, seconds = learned(turning(steps, direction))
    assert number <= steps + 1
    assert seconds == pytest.approx(2.5)


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_detections_at_different_ranges_show_it_too(share):
    number, seconds = learned(turning(180, whole=False, share=share))
    assert number <= 1.1 * 180 + 10
    assert seconds == pytest.approx(2.5, rel=0.02)


@pytest.mark.parametrize("back", [True, False])
def test_a_sector_is_a_sweep_after_two_passes(back):
    there = np.linspace(-1.0, 1.0, 41)
    azimuths = np.concatenate([there, there[::-1] if back else there] * 3)[17:]
    number, seconds = learned([beam(0.1 * n, float(a)) for n, a in enumerate(azimuths)])
    assert number <= 2.7 * 41
    assert seconds == pytest.approx(4.1, rel=0.05)


@pytest.mark.parametrize("name", shipped_scenarios())
def test_no_shipped_scenario_is_one(name):
    simulator = Simulator(load_scenario(name), 3)
    assert (
        learned(echoes(one.scan.stamp, one.scan.azimuth, one.scan.range) for one in simulator)
        is None
    )


def test_a_fan_that_stays_or_is_panned_slowly_and_a_target_to_and_fro_are_none():
    fans = [
        UnregisteredScan(Scan(float(n), [], []), "sonar", beams=ScanArc(-0.5, 1.0, True))
        for n in range(500)
    ]
    assert learned(fans) is None
    fans = [
        UnregisteredScan(Scan(float(n), [], []), "sonar", beams=ScanArc(0.05 * n, 1.0, True))
        for n in range(1000)
    ]
    assert learned(fans) is None
    pings = [echoes(float(n), [math.sin(0.05 * n)], [200.0]) for n in range(2000)]
    assert learned(pings) is None


@pytest.mark.long
def test_few_detections_here_and_there_are_none():
    rng = np.random.default_rng(1)
    for number in (0.5, 1.0, 3.0):
        pings = (
            echoes(float(n), rng.uniform(-np.pi, np.pi, m), rng.uniform(1.0, 900.0, m))
            for n, m in enumerate(rng.poisson(number, 8_000))
        )
        assert learned(pings) is None


def test_a_buoy_seen_from_a_turning_vessel_is_none():
    rng = np.random.default_rng(1)
    for noise in (0.0, 0.01):
        pings = [
            echoes(
                float(n),
                [math.remainder(-0.1 * n + noise * rng.standard_normal(), 2 * math.pi)],
                [200.0 + rng.standard_normal()],
            )
            for n in range(400)
        ]
        assert learned(pings) is None
