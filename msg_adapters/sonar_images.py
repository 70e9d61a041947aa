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
"""From arriving messages of images to detections, for the node and offline runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters.image_messages import Plan, plan_of, read_image
from msg_adapters.nav_messages import read_own_ship
from msg_adapters.stamps import MessageError
from tsepm_ros.detector.bright_lines import BRIGHT_SHARE, LOOKS, measured_values, medians
from tsepm_ros.detector.detector import Detector
from tsepm_ros.detector.image import DetectorOptions, ImageCoverage, SonarImage
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import PoseCoverage, PoseSample
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.session.consistency_checks import DEGREES
from tsepm_ros.session.inputs import OwnShipInput
from tsepm_ros.session.turn import ImagePing, ImageTurns
from tsepm_ros.settings.node_options import ImageLayout, SessionOptions, SonarDetectorNodeOptions
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import Coverage

PLAN_PERIOD = 0.5
"""Least time between two plans, s."""
POSE_AGE = 1.0
"""Time after the newest pose over which a pose is extrapolated, s; the background can wait."""
MAX_LATE = 5.0
"""Time of poses that are all late after which they count as a new run's, s."""
OTHER_CLOCK = (
    f"own-ship data and images are more than {MAX_LATE:g} s apart by their stamps: until they "
    "agree, the sonar counts as at rest"
)
MOST_PLANS = 500
"""Most plans of an offline run."""
MAX_ANGLE = 4.0 * np.pi
"""Largest bearing that a sector from -2 pi to 2 pi may have, rad."""
EVEN_STEP, EVEN_SHARE = 0.02, 0.7
"""Largest step from cell to cell, as a part of the value and of the spread of all, and share of the
steps, from which on values are no echoes, which are speckled."""
ALL_ROUND = 6.0
"""Bearings from which on more of them than ranges are nothing strange, rad."""


class FirstLook:
    """What the first images of a shape show that another layout explains.

    Parameters
    ----------
    looks : int, optional
        Images in each of which it must be.
    """

    def __init__(self, looks: int = LOOKS) -> None:
        self._looks, self._left, self._shape = looks, 0, (0, 0)

    def add(self, ping: Any, rows: str = "") -> list[str]:
        """Take an image; the sentences, with the last of the first images.

        Parameters
        ----------
        ping : ImagePing or SonarImage
        rows : str, optional
            Of the layout by which a picture was read; empty: the message states its geometry.
        """
        b, m = ping.intensity.shape
        if self._shape != (b, m):
            self._shape, self._left, self._always = (b, m), self._looks, np.ones(2, bool)
        if self._left <= 0:
            return []
        low = measured_values(ping.intensity)
        middle, bright = np.quantile(low, [0.5, BRIGHT_SHARE], method="lower")
        spread = [float(np.ptp(np.quantile(level, [0.1, 0.9]))) for level in medians(low)]
        varies = spread[0] > 2.0 * spread[1] + 0.2 * (float(bright) - float(middle))
        swapped = varies or (b > m and np.ptp(ping.azimuth) < ALL_ROUND)
        fan, asked = _is_fan(low) or _is_fan(low.T), rows not in ("", "fan")
        self._always &= [swapped and not fan, fan]
        self._left -= 1
        other = ("ranges", "beams") if rows == "beams" else ("beams", "ranges")
        sentences = {
            f"{b} bearings of {m} ranges look transposed: if the rows of the image are {other[0]}, "
            f"not {other[1]}, give {other[0]} for rows (image.rows)": asked and self._always[0],
            "the corners of the image are blank as around a fan, and it is read as bearings and "
            "ranges: if it is a picture in x and y, give fan for rows (image.rows)": asked
            and self._always[1],
        }
        return [words for words, holds in sentences.items() if holds and not self._left]


def content_in_question(values: NDArray[Any], stated: bool) -> str:
    """A sentence on values (b, m) that hold nothing, or look like distances; else empty.

    A depth camera's distances change little from cell to cell, in both directions. `stated`: the
    message states its geometry, as a sonar's does.
    """
    there = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    if not there.size or there.min() == there.max():
        held = f"the value {there.flat[0]:g}" if there.size else "no number"
        return (
            f"every cell of the image has {held}: is the head out of the water, a cable loose, or "
            "the gain 0? An image of a driver with a threshold is so where there is no echo"
        )
    if stated or values.itemsize == 1:
        return ""
    some, even = there.ravel(order="K"), []
    spread = float(np.ptp(np.quantile(some[:: 1 + len(some) // 10**5], [0.05, 0.95])))
    for image in values, values.T:
        by = 1 + len(image) // 64
        near, far = (image[k : len(image) - 1 + k : by].astype(float) for k in (0, 1))
        steps = np.abs(far - near)
        known = np.isfinite(steps) & (near > 0.0)
        small = (steps > 0.0) & (steps < EVEN_STEP * np.minimum(near, spread))
        even.append(np.count_nonzero(small & known) >= EVEN_SHARE * max(known.sum(), 1))
    return (
        "the values of the image change as little from cell to cell as distances do, not as "
        "echoes: is it the image of a depth camera? The node takes intensities"
    ) * all(even)


def _is_fan(values: NDArray[Any]) -> bool:
    """Whether (b, m) values are blank at both sides, the less so the farther from an end."""
    b, m = values.shape
    filled = values != values[0, -1]
    run = np.where(filled.any(axis=0), [filled.argmax(axis=0), filled[::-1].argmax(axis=0)], b)
    ends = run[:, [m // 20, m // 10]], run[:, [-1 - m // 20, -1 - m // 10]]
    return any(
        0.5 * b > end[:, 0].min() > end[:, 1].max() >= end[:, 1].min() > 0.02 * b
        and np.ptp(end, axis=0).max() <= 0.02 * b + 2.0
        for end in ends
    )


class ImageInput:
    """From arriving messages of images to detections, for the node and offline runs.

    Parameters
    ----------
    options : mapping of type to options
        Of the groups of SONAR_DETECTOR; without a coverage, it has no limits.
    drop : callable
        Called with a reason and a sentence for an image that is not used.
    say : callable
        Called with each sentence about what a message does not state.

    Attributes
    ----------
    detector : Detector
    turns : ImageTurns
    in_parts : bool
        Whether the last message was of some bearings of a turn.
    coverage : ImageCoverage or None
        Of the images, within the detector's: of the first, then of two in a row.
    coverage_changes : int
        Images with another coverage than the one before.
    look_up : callable
        Called with each message as read, to add the sensor's pose where it must be fetched.
    own_ship : OwnShipInput
        Poses of the vessel; none where the sonar does not move, or its poses are not known.
    elsewhere : bool
        Whether echoes of the last image lie elsewhere than those before, as the layout of pictures
        was given anew: tracks are to end.
    content : str
        What is odd of the values of the last image, in a sentence; empty: nothing.
    behind : float
        Age of the newest pose at the last image, by the stamps, s; nan while unknown.
    plans : list of Plan or None
        Of the images, where a display needs them: at most one in `PLAN_PERIOD`, and `MOST_PLANS`.
    """

    def __init__(
        self,
        options: Mapping[type[Any], Any],
        drop: Callable[[str, str], None],
        say: Callable[[str], None],
    ) -> None:
        self._options: Mapping[type[Any], Any] = {
            Coverage: Coverage(),
            Mounting: Mounting(),
            **options,
        }
        self._drop, self._say = drop, say
        self.look_up: Callable[[ImagePing], None] = lambda ping: None
        self.plans: list[Plan] | None = None
        self.in_parts = self.elsewhere = self._given_anew = self._asked_degrees = False
        self._look = FirstLook()
        self.content, self._odd = "", 0
        self.behind = math.nan
        self.turns = ImageTurns(drop, say)
        self.detector = Detector(options[DetectorOptions], self._options[Coverage])
        self.coverage = self._other = None  # type: ImageCoverage | None
        self.coverage_changes, self._axes = 0, (b"", b"")
        given: SonarDetectorNodeOptions = options[SonarDetectorNodeOptions]
        self.own_ship = OwnShipInput(
            SessionOptions(
                own_ship_source=given.own_ship_source,
                own_ship_delay=given.own_ship_delay,
                own_ship_timeout=MAX_LATE,
                own_ship_max_extrapolation=POSE_AGE,
                own_ship_max_gap=3600.0,
                restart_jump=math.inf,
            )
        )

    def take_own_ship(self, message: Any) -> None:
        """Take a nav_msgs/Odometry, if the poses of the sonar come by odometry."""
        given: SonarDetectorNodeOptions = self._options[SonarDetectorNodeOptions]
        if given.own_ship_source != "odometry":
            return
        try:
            self.add_pose(read_own_ship(message, given.fixed_frame))
        except MessageError as error:
            self._drop("own_ship_invalid", f"own-ship data dropped: {error}")

    def add_pose(self, sample: PoseSample) -> None:
        """Add a pose, as for scans; late ones are no news, as tf repeats them."""
        for reason, sentence, *_ in self.own_ship.add(sample):
            if reason in ("own_ship_invalid", "own_ship_outlier"):
                self._drop(reason, sentence)

    def _pose(self, ping: ImagePing) -> FloatArray | None:
        """Pose of the sensor for an image, or for each bearing; None: unknown.

        From tf it is the sensor's, from odometry the vessel's.
        """
        if not len(self.own_ship.poses):
            return None
        offset = np.zeros(1) if ping.time_offset is None else ping.time_offset
        times = 1e-9 * ping.stamp_ns + offset
        self.behind = float(times.max()) - (self.own_ship.poses.last_stamp or 0.0)
        early = self.own_ship.poses.coverage(times.max(), times.max()) is PoseCoverage.NEVER
        if early or times.min() - (self.own_ship.poses.last_stamp or 0.0) > MAX_LATE:
            self._say(OTHER_CLOCK)
        given: SonarDetectorNodeOptions = self._options[SonarDetectorNodeOptions]
        mounting = Mounting() if given.own_ship_source == "tf" else self._options[Mounting]
        poses = mounting.image_poses(self.own_ship.poses.held_poses(times))
        return poses if len(poses) == len(ping.azimuth) else poses[0]

    def configure(self, options: Mapping[type[Any], Any]) -> None:
        """Take changed options; what the detector learned stays unless its own changed."""
        if any(options[kind] != self._options[kind] for kind in (DetectorOptions, Coverage)):
            self.detector = Detector(options[DetectorOptions], options[Coverage])
            self.coverage = self._other = None
        if options[ImageLayout] != self._options[ImageLayout]:
            self.coverage, self._given_anew = None, True
        self._options, self._look = options, FirstLook()

    def take(
        self, message: Any, is_late: Callable[[ImagePing], bool] = lambda turn: False
    ) -> Iterator[tuple[ImagePing, Scan]]:
        """Take a message; the pings that it completes and the detections of each.

        Turns of bearings that are late are passed over.
        """
        given: SonarDetectorNodeOptions = self._options[SonarDetectorNodeOptions]
        layout: ImageLayout = self._options[ImageLayout]
        try:
            ping = read_image(message, layout, self._options[Coverage], given.sound_speed)
        except MessageError as error:
            self._drop(error.reason, f"image dropped: {error}")
            return
        self.look_up(ping)
        for assumption in ping.assumptions:
            self._say(assumption)
        largest = float(np.abs(ping.azimuth).max())
        if largest > MAX_ANGLE and not self._asked_degrees:
            self._asked_degrees = True
            self._say(f"bearings of an image are beyond 2 pi, up to {largest:.4g}: {DEGREES}")
        self.in_parts = ping.is_part
        for whole in self.turns.add(ping):
            if ping.is_part and is_late(whole):
                continue
            self._judge_content(whole)
            try:
                axes = whole.range, whole.azimuth, whole.intensity, whole.time_offset
                stamp, states_ranges = 1e-9 * whole.stamp_ns, not whole.corners
                image = SonarImage(stamp, *axes, self._pose(whole), states_ranges)
                scan = self.detector.process(image)
            except ValueError as error:
                self._drop("bad_image", f"image dropped: {error}")
                continue
            self.elsewhere = self._given_anew and bool(whole.corners)
            self._given_anew = False
            looks = self._look.add(whole, layout.rows if whole.corners else "")
            for sentence in (*looks, *self.detector.notes):
                self._say(sentence)
            self._cover(whole)
            self._draw(whole)
            yield replace(whole, sound_speed=whole.sound_speed or given.sound_speed), scan

    def _judge_content(self, ping: ImagePing) -> None:
        """Look whether an image's values are echoes; it is said where they are none for long."""
        self.content = content_in_question(ping.intensity, not ping.corners)
        self._odd = self._odd + 1 if self.content else 0
        if self._odd == LOOKS:
            self._say(f"{LOOKS} images in a row: {self.content}")

    def _cover(self, ping: ImagePing) -> None:
        """Note the coverage of an image; another one counts where the next image has it too."""
        before, axes = self._other, (ping.range.tobytes(), ping.azimuth.tobytes())
        if before is not None and before is self.coverage and axes == self._axes:
            return
        now = ImageCoverage(ping.range, ping.azimuth, self._options[Coverage])
        self._other, self._axes = now, axes
        if before is not None and not before.agrees([*now.values.values()]):
            self.coverage_changes += 1
        elif self.coverage is None or not self.coverage.agrees([*now.values.values()]):
            self.coverage = now

    def _draw(self, ping: ImagePing) -> None:
        """Keep the plan of an image, where these are kept."""
        stages, plans = self.detector.stages, self.plans
        if stages is None or plans is None or len(plans) >= MOST_PLANS:
            return
        if not plans or abs(ping.stamp_ns - plans[-1].stamp_ns) >= 1e9 * PLAN_PERIOD:
            plans.append(plan_of(ping, stages))


def detection_fields(ping: ImagePing, scan: Scan) -> dict[str, Any]:
    """What a message of a ping's detections has: fields of `detections_cloud`, (n,) each.

    Each echo has the time of its bearing and that of its travel, 0 where no sound speed is known.
    """
    travel = 2.0 * scan.range / (ping.sound_speed or np.inf)
    sent = 0.0 if scan.time_offset is None else scan.time_offset
    times = {"time_offset": sent + 0.5 * travel, "two_way_travel_time": travel}
    angle = {"rx_angle": -scan.azimuth} if ping.axes == "sonar" else {"azimuth": scan.azimuth}
    fields = {name: getattr(scan, name) for name in ("range", "range_std", "azimuth_std")}
    return fields | angle | times | dict(scan.features)
