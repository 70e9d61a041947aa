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
"""Drop reasons: what is dropped, why, and what remedies it.

The parts of a session return rejections and notices, which the session counts and reports. Each
reason has a row in `DROP_REASONS`: its entry of the diagnostics, what a drop loses, its cause and
its remedy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

INTERNAL_ERROR = "internal_error"
"""Reason of what nothing else has caught: the scan or message is dropped, and the next is taken."""
REPORT_IT = (
    "internal_error, a fault of the node: report the traceback in the log, with the version, the "
    "parameters and a bag of the messages"
)
"""Its remedy."""
MAX_SENTENCE = 500
"""Characters of a reported sentence. The names in a message may be as long as the message."""
CUT = " ... "
DETECTIONS, OWN_SHIP = "detections", "own ship"
TRACKER, INITIATION = "downstream tracker", "track initiation"
LAND = "land"
_DRIVER = "Fix the driver"
_TRACKER = "Fix the tracker"
EXPECTED = "None: this is expected"
_LAYOUT = {
    "missing_field": ("a required field is missing", f"{_DRIVER}, or see docs/topics.md"),
    "duplicate_field": ("a field occurs twice", _DRIVER),
    "wrong_datatype": ("a field has an unsupported datatype", "Send FLOAT32 or FLOAT64"),
    "wrong_count": ("a field has a count other than 1", _DRIVER),
    "bad_offset": ("fields overlap, or extend beyond the point", _DRIVER),
    "bad_row_step": ("the row step is shorter than the points of a row", _DRIVER),
    "short_data": ("the data is shorter than the rows", _DRIVER),
}
"""Faults of a whole cloud, of detections or of tracked targets."""
NUMBERS = {
    "range": ("not_finite", "not_positive", "too_small", "too_large"),
    "azimuth": ("not_finite",),
    "range_std": ("not_positive", "too_small", "too_large"),
    "azimuth_std": ("not_positive", "too_small", "too_large"),
    "time_offset": ("not_finite", "too_large"),
    "transmit_offset": ("not_finite", "too_large"),
}
"""Quantities of detections, and their faults in the order in which they count."""
_FAULTS = {
    "not_finite": "is nan or infinite",
    "not_positive": "is not a positive number",
    "too_small": "is below the limit",
    "too_large": "is above the limit",
}
_MISSING = "None if the sensor marks missing values like this; else check the driver and its units"


def shortened_reason(sentence: str) -> str:
    """A sentence without its middle if it is longer than `MAX_SENTENCE`."""
    if len(sentence) <= MAX_SENTENCE:
        return sentence
    end = (MAX_SENTENCE - len(CUT)) // 2
    return sentence[: MAX_SENTENCE - len(CUT) - end] + CUT + sentence[-end:]


class Rejection(NamedTuple):
    """A drop with its reason, which the session counts and reports.

    Attributes
    ----------
    reason : str
        A name of `drop_reasons.DROP_REASONS`.
    sentence : str
        Message for the log; empty where drops are expected, and only counted.
    number : int
        Number of drops.
    """

    reason: str
    sentence: str
    number: int = 1


class Notice(NamedTuple):
    """An event that is reported without a drop.

    Attributes
    ----------
    subject : str
        Kind of the notice.
    sentence : str
        Message for the log.
    """

    subject: str
    sentence: str


Remark = Rejection | Notice


@dataclass(frozen=True)
class DropReason:
    """Description of a drop reason.

    Attributes
    ----------
    task : str
        Entry on ``/diagnostics`` that counts the drops.
    lost : {"detection", "scan", "message", "pose", "target", "report", "chart"}
        What one drop loses: one detection, one scan, one message of a turn, one sample of own-ship
        data, one tracked target, one message of the downstream tracker, or one message of `land`.
    meaning, remedy : str
    """

    task: str
    lost: str
    meaning: str
    remedy: str


DROP_REASONS: Mapping[str, DropReason] = {
    **{
        fault: DropReason(DETECTIONS, "scan", meaning, remedy)
        for fault, (meaning, remedy) in _LAYOUT.items()
    },
    **{
        f"tracked_{fault}": DropReason(
            TRACKER, "report", meaning, f"{_TRACKER}: the message must have the layout of `tracks`"
        )
        for fault, (meaning, _) in _LAYOUT.items()
    },
    **{
        f"{name}_{fault}": DropReason(
            DETECTIONS, "detection", f"the value {_FAULTS[fault]}", _MISSING
        )
        for name, faults in NUMBERS.items()
        for fault in faults
    },
    "wrong_length": DropReason(
        DETECTIONS, "scan", "the lengths of the message's arrays do not match", _DRIVER
    ),
    "no_geometry": DropReason(
        DETECTIONS,
        "scan",
        "neither an image nor the parameters state ranges and bearings",
        "Set `image.near_range`, `image.far_range`, `sensor.azimuth_min` and `sensor.azimuth_max` "
        "of `sonar_detector`",
    ),
    "bad_encoding": DropReason(
        DETECTIONS,
        "scan",
        "an image has numbers of another kind, such as colours",
        "Publish the sonar's raw image",
    ),
    "bad_geometry": DropReason(
        DETECTIONS,
        "scan",
        "an image has no ranges above 0, no sample rate, or a bearing or its time is no number",
        _DRIVER,
    ),
    "bad_image": DropReason(
        DETECTIONS,
        "scan",
        "the ranges or bearings of an image are in no order, or a value is infinite",
        _DRIVER,
    ),
    "bearing_stamp": DropReason(
        DETECTIONS,
        "message",
        "the stamp of a bearing, or of a sector, is not the time at which the beam looks there",
        "None if these are few; else look at the clock of the driver, and at its `header.stamp`",
    ),
    "bearing_azimuth": DropReason(
        DETECTIONS,
        "message",
        "the azimuth of a bearing, or of a sector, is not where the beam looks at its stamp",
        "None if these are few; else look for two drivers on one topic, or for "
        "messages that are lost",
    ),
    "bearing_geometry": DropReason(
        DETECTIONS,
        "message",
        "the ranges, the frame or the angle increment differ from those of most messages of a turn",
        "None if these are few; else look for two drivers, or displays, of one topic",
    ),
    "image_repeated": DropReason(
        DETECTIONS,
        "scan",
        "an image, or a bearing, equals the previous one to the bit",
        "None if the driver publishes faster than the sonar pings; else look for a sonar or a "
        "driver that has stopped",
    ),
    "bearing_repeated": DropReason(
        DETECTIONS,
        "message",
        "neighbouring bearings equal those of the previous image to the bit, though others change",
        "Publish the picture of a turning head once a turn; else fix the driver",
    ),
    "unknown_type": DropReason(
        DETECTIONS, "scan", "no adapter supports this type", "Use a type from docs/topics.md"
    ),
    "unknown_version": DropReason(
        DETECTIONS,
        "scan",
        "the message has other fields than the versions of its type that are read",
        "Publish, or convert the bag to, a version that docs/topics.md names",
    ),
    "package_not_installed": DropReason(
        DETECTIONS, "scan", "the package of the type is not installed", "Install the package"
    ),
    "stamp_invalid": DropReason(
        DETECTIONS, "scan", "`nanosec` of the stamp is a second or more", _DRIVER
    ),
    "too_many_detections": DropReason(
        DETECTIONS,
        "scan",
        "the scan has more detections than `max_detections`",
        "Raise the detection threshold of the sensor, or `max_detections`",
    ),
    "unknown_frame": DropReason(
        DETECTIONS,
        "scan",
        "the frame differs from that of earlier scans, or from `sensor_frame`, or is that of "
        "another of the `sensors`",
        "Look for two drivers on one topic. Name several sonars in `sensors`, which need "
        "`mounting` or `own_ship_source` tf if their frames differ; call `~/reset` after a change "
        "of the frame",
    ),
    "empty_frame": DropReason(
        DETECTIONS,
        "scan",
        "the `frame_id` is empty",
        "Set the `frame_id` in the driver, or set `sensor_frame`; for a sensor that does not move, "
        "`fixed_frame` is sufficient",
    ),
    "scan_same_stamp": DropReason(
        DETECTIONS,
        "scan",
        "the stamp equals that of the previous scan",
        "Look for two drivers on one topic, or a driver that sends scans twice or does not set "
        "`header.stamp` anew",
    ),
    "scan_repeated": DropReason(
        DETECTIONS,
        "scan",
        "all detections equal those of the previous scan to the bit, though other scans differ",
        "Look for a driver or a relay that sends a scan again under a new stamp",
    ),
    "detection_repeated": DropReason(
        DETECTIONS,
        "detection",
        "neighbouring detections equal those of the previous scan to the bit, though others "
        "change; or two detections of a scan are equal",
        "None if values are coarse; else fix the driver",
    ),
    "scan_late": DropReason(
        DETECTIONS,
        "scan",
        "the stamp is before that of the last scan, by less than `restart_jump`. With several "
        "sensors: it is before the last scan of another sensor, or the clock of this sensor alone "
        "went back",
        "Look for scans that arrive out of order. If a clock was set back, the third late scan "
        "restarts the state. With several sensors, raise `max_wait`, or compare their clocks",
    ),
    "message_late": DropReason(
        DETECTIONS,
        "message",
        "the stamp of a message of a turn is before that of the previous message",
        "Look for messages that arrive out of order",
    ),
    "scan_far_back": DropReason(
        DETECTIONS,
        "scan",
        "the stamp is before that of the last scan by more than `restart_jump`, and the next scan "
        "does not continue from it",
        _DRIVER + ": stamps must rise after a restart",
    ),
    "scan_ahead": DropReason(
        DETECTIONS,
        "scan",
        "the stamp is later than that of the next scan, which continues from the scan before",
        _DRIVER + ": it set a wrong `header.stamp`",
    ),
    "stamp_not_set": DropReason(
        DETECTIONS,
        "scan",
        "the stamp is 0 between nonzero stamps, or repeatedly",
        _DRIVER + ": it must set `header.stamp`",
    ),
    "frame_axes": DropReason(
        DETECTIONS,
        "scan",
        "the name of the frame states z ahead, so that angles about z are not horizontal",
        "Use the name of a frame with x ahead and z up (REP-103)",
    ),
    "elevation_not_finite": DropReason(
        DETECTIONS, "detection", "the elevation is nan or infinite", _DRIVER
    ),
    "flagged_bad": DropReason(
        DETECTIONS, "detection", "the sonar flags the detection as bad", EXPECTED
    ),
    "direction_undefined": DropReason(
        DETECTIONS, "detection", "the angles or the vector do not define a direction", _DRIVER
    ),
    "range_below_min": DropReason(
        DETECTIONS,
        "detection",
        "the range is below the scan's `range_min`",
        "None if these are few; else the driver must set `range_min` in m",
    ),
    "range_above_max": DropReason(
        DETECTIONS,
        "detection",
        "the range is above the scan's `range_max`",
        "None if these are few; else the driver must set `range_max` in m",
    ),
    "outside_coverage": DropReason(
        DETECTIONS,
        "detection",
        "the detection is outside the sensor's coverage by more than three standard deviations",
        "Compare `sensor.min_range`, `sensor.max_range`, `sensor.azimuth_min` and "
        "`sensor.azimuth_max` with the sonar's settings; none if the coverage is limited "
        "on purpose",
    ),
    "no_position": DropReason(
        DETECTIONS, "detection", "the detection has neither a box nor a result", "Fix the detector"
    ),
    "other_frame": DropReason(
        DETECTIONS,
        "detection",
        "the frame of the detection's header differs from that of the message",
        "Use one frame per message in the detector",
    ),
    "echo_too_late": DropReason(
        DETECTIONS,
        "detection",
        "the sensor moves, and the echo is a minute or more from its ping, or the ping an hour or "
        "more from the stamp",
        _DRIVER + ": `time_offset` is in seconds (not ms, us or ns), after `header.stamp`",
    ),
    "own_ship_missing": DropReason(
        OWN_SHIP,
        "scan",
        "no own-ship data arrived within `own_ship_timeout`",
        "Check `own_ship/odometry` (remapping, publisher, quality of service), or tf",
    ),
    "own_ship_stale": DropReason(
        OWN_SHIP,
        "scan",
        "within `own_ship_timeout`, no own-ship data reaches the time of the scan; or the data "
        "begins after the scan, or has a gap there",
        "Compare the clocks of sonar and navigation, unless this is the start; a stamp of 0 is "
        "not set; check `own_ship_timeout`, `own_ship_max_extrapolation` and `own_ship_max_gap`",
    ),
    "own_ship_jump": DropReason(
        OWN_SHIP,
        "scan",
        "own ship jumps during the scan, or its poses are impossibly far apart",
        "Check the navigation: its positions are in m, its velocities in m/s",
    ),
    "own_ship_outlier": DropReason(
        OWN_SHIP,
        "pose",
        "own ship jumps to one pose, and back with the next pose; or one stamp jumps ahead, and "
        "back",
        "None if these are few; else check the navigation",
    ),
    "message_corrupt": DropReason(
        DETECTIONS,
        "scan",
        "a message in a bag is unreadable (offline runs only; on any topic)",
        "Record again, or check the program that wrote the bag",
    ),
    "no_horizontal_range": DropReason(
        DETECTIONS,
        "detection",
        "the detection is vertically above or below the sonar, after correction of roll and pitch",
        "None if it is rare; else check the attitude",
    ),
    "heading_unknown": DropReason(
        OWN_SHIP,
        "scan",
        "the own-ship data has no heading, and the detections need it",
        "Provide odometry with a heading, or bearings from north with an all-round coverage",
    ),
    "clock_invalid": DropReason(
        DETECTIONS,
        "message",
        "a time on /clock is before 1970, or its `nanosec` is a second or more",
        "Fix the publisher of /clock, or set `use_sim_time` to false",
    ),
    "overload": DropReason(
        DETECTIONS,
        "scan",
        "messages waited in the middleware for over 2 s and over 5 scan intervals, or images came "
        "faster than `sonar_detector` processes them. Only the newest was taken",
        "Reduce the sonar's rate, its detections or the cells of its images, or `max_scan_time`",
    ),
    "queue_full": DropReason(
        OWN_SHIP,
        "scan",
        "too many scans wait for own-ship data",
        "Reduce `own_ship_timeout`, and find out why the data does not arrive",
    ),
    "own_ship_invalid": DropReason(
        OWN_SHIP,
        "pose",
        "the odometry is not finite, has no orientation or an invalid covariance, or its frame has "
        "z ahead",
        "Fix the source; the warning names the field",
    ),
    "own_ship_frame": DropReason(
        OWN_SHIP,
        "pose",
        "the odometry is not in the fixed frame",
        "Set `fixed_frame`, or publish in the fixed frame",
    ),
    "own_ship_empty_frame": DropReason(
        OWN_SHIP,
        "pose",
        "the `frame_id` of the odometry is empty",
        "Set the `frame_id` in the source, or set `fixed_frame`",
    ),
    "own_ship_late": DropReason(
        OWN_SHIP,
        "pose",
        "the stamp is not after that of the last sample",
        "Look for two publishers on one topic",
    ),
    "tracked_bad_id": DropReason(
        TRACKER, "report", "a `track_id` is not an integer from 0 to 2^32 - 1", _TRACKER
    ),
    "tracked_stamp_invalid": DropReason(
        TRACKER, "report", "`nanosec` of the stamp is a second or more", _TRACKER
    ),
    "tracked_frame": DropReason(
        TRACKER,
        "report",
        "the report is not in the fixed frame",
        "Publish in the frame of `tracks`",
    ),
    "tracked_late": DropReason(
        TRACKER, "report", "the stamp is before that of the last report", "Look for two trackers"
    ),
    "tracked_stale": DropReason(
        TRACKER,
        "report",
        "the stamp differs from the scan's by more than `tracked_timeout`",
        "Stamp reports with the scan's time; check `tracked_timeout`",
    ),
    "tracked_not_finite": DropReason(
        TRACKER, "target", "the state or covariance is not finite, or too large", _TRACKER
    ),
    "tracked_bad_covariance": DropReason(
        TRACKER, "target", "the covariance is not positive definite", _TRACKER
    ),
    "tracked_duplicate_id": DropReason(
        TRACKER, "target", "the `track_id` occurs earlier in the report", _TRACKER
    ),
    "on_land": DropReason(
        LAND, "detection", "the detection is on an occupied cell of `land`", EXPECTED
    ),
    "land_frame": DropReason(
        LAND,
        "chart",
        "`land` is not in the fixed frame",
        "Publish the grid in the frame of `tracks`, or set `fixed_frame`",
    ),
    "land_invalid": DropReason(
        LAND,
        "chart",
        "the grid's size, resolution or origin is not usable; the warning names it",
        "Fix the publisher of `land`",
    ),
    INTERNAL_ERROR: DropReason(
        INITIATION,
        "scan",
        "registration, processing, publishing or another callback failed; if the algorithm failed, "
        "all tracks are discarded",
        f"Check the own-ship data for jumps; else this is an {REPORT_IT}",
    ),
}
"""Drop reasons by the name that is counted."""


def drop_reason_of(name: str) -> DropReason:
    """Return the description of a reason; unknown reasons, of a user's adapter, are detections'."""
    return DROP_REASONS.get(name) or DropReason(DETECTIONS, "detection", "", "")
