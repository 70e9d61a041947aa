"""Every reason for which something is dropped: where it is reported, what it means, what to do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

DETECTIONS, OWN_SHIP = "detections", "own ship"
TRACKER, INITIATION = "downstream tracker", "track initiation"


@dataclass(frozen=True)
class DropReason:
    """What is known of a reason.

    Attributes
    ----------
    task : str
        Entry on ``/diagnostics`` that it belongs to.
    lost : {"detection", "scan", "pose", "target", "report"}
        What one drop loses: one detection, one scan, one sample of own-ship data, one tracked
        target, or one message of the downstream tracker.
    meaning, remedy : str
    """

    task: str
    lost: str
    meaning: str
    remedy: str


_DRIVER = "Mend the driver"
_LAYOUT = {
    "missing_field": ("a field that is needed is not there", f"{_DRIVER}, or see docs/drivers.md"),
    "duplicate_field": ("a field is there twice", _DRIVER),
    "wrong_datatype": ("a field has a datatype that is not read", "Send FLOAT32 or FLOAT64"),
    "wrong_count": ("a field is not one number per point", _DRIVER),
    "bad_offset": ("fields overlap or end beyond the point", _DRIVER),
    "bad_row_step": ("the rows are shorter than their points", _DRIVER),
    "short_data": ("there are fewer bytes than the header says", _DRIVER),
}
"""Faults of a cloud as a whole: of the detections, and of what is tracked."""

_NUMBERS = {
    "range": ("range", ("not_finite", "not_positive", "too_small", "too_large")),
    "azimuth": ("azimuth", ("not_finite",)),
    "range_std": ("standard deviation of the range", ("not_positive", "too_small", "too_large")),
    "azimuth_std": (
        "standard deviation of the azimuth",
        ("not_positive", "too_small", "too_large"),
    ),
    "time_offset": ("time after the stamp", ("not_finite", "too_large")),
    "transmit_offset": ("transmit delay", ("not_finite", "too_large")),
}
_FAULTS = {
    "not_finite": "is nan or infinite",
    "not_positive": "is not above 0, or no number",
    "too_small": "is smaller than any sensor's",
    "too_large": "is larger than any sensor's",
}


def _of_layouts() -> Iterator[tuple[str, DropReason]]:
    for fault, (meaning, remedy) in _LAYOUT.items():
        yield fault, DropReason(DETECTIONS, "scan", meaning, remedy)
    for fault, (meaning, _) in _LAYOUT.items():
        remedy = "Mend the tracker: it sends the layout of `tracks`"
        yield f"tracked_{fault}", DropReason(TRACKER, "report", meaning, remedy)


def _of_numbers() -> Iterator[tuple[str, DropReason]]:
    for name, (what, faults) in _NUMBERS.items():
        remedy = "None where the sensor has nothing to say; else check the driver, and its units"
        for fault in faults:
            meaning = f"the {what} {_FAULTS[fault]}"
            yield f"{name}_{fault}", DropReason(DETECTIONS, "detection", meaning, remedy)


_SINGLE = {
    "wrong_length": DropReason(DETECTIONS, "scan", "arrays of the message do not fit", _DRIVER),
    "unknown_type": DropReason(
        DETECTIONS, "scan", "no adapter reads this type", "Use a type of docs/drivers.md"
    ),
    "package_not_installed": DropReason(
        DETECTIONS, "scan", "the type's package is not installed", "Install the package"
    ),
    "too_many_detections": DropReason(
        DETECTIONS,
        "scan",
        "it has more detections than `max_detections`",
        "Raise the sensor's own threshold, or `max_detections`",
    ),
    "unknown_frame": DropReason(
        DETECTIONS,
        "scan",
        "its frame is not that of the scans before, or of `sensor_frame`",
        "One node for each sonar; after a change of the frame call `~/reset`",
    ),
    "empty_frame": DropReason(
        DETECTIONS,
        "scan",
        "its `frame_id` is empty",
        "Let the driver name one, or give `sensor_frame`; a sensor that does not move may be given "
        "`fixed_frame`",
    ),
    "scan_same_stamp": DropReason(
        DETECTIONS,
        "scan",
        "its stamp is that of the scan before",
        "Look for two drivers on one topic, or a driver that sends scans twice",
    ),
    "scan_late": DropReason(
        DETECTIONS,
        "scan",
        "its stamp is before that of the last scan, by less than `restart_jump`",
        "Look for scans that overtake each other; a clock set back ends by itself after three",
    ),
    "scan_far_back": DropReason(
        DETECTIONS,
        "scan",
        "its stamp is before that of the last scan by more than `restart_jump`, and the next one's "
        "does not follow on it",
        _DRIVER + ": a restart has rising stamps",
    ),
    "stamp_not_set": DropReason(
        DETECTIONS,
        "scan",
        "its stamp is 0 between others that are not, or again and again",
        _DRIVER + ": it does not fill `header.stamp`",
    ),
    "elevation_not_finite": DropReason(
        DETECTIONS, "detection", "its elevation is nan or infinite", _DRIVER
    ),
    "flagged_bad": DropReason(
        DETECTIONS, "detection", "the sonar itself flags it as bad", "None: it is right so"
    ),
    "direction_undefined": DropReason(
        DETECTIONS, "detection", "its angles or its vector give no direction", _DRIVER
    ),
    "range_below_min": DropReason(
        DETECTIONS, "detection", "it is nearer than the scan's `range_min`", "None: it is right so"
    ),
    "range_above_max": DropReason(
        DETECTIONS, "detection", "it is beyond the scan's `range_max`", "None: it is right so"
    ),
    "outside_coverage": DropReason(
        DETECTIONS,
        "detection",
        "it is outside the sensor's coverage by more than three standard deviations",
        "Compare `sensor.min_range`, `sensor.max_range`, `sensor.azimuth_min` and "
        "`sensor.azimuth_max` with the sonar's settings; none where the coverage is limited "
        "on purpose",
    ),
    "no_position": DropReason(
        DETECTIONS, "detection", "it has neither a box nor a result", "Mend the detector"
    ),
    "other_frame": DropReason(
        DETECTIONS,
        "detection",
        "its own header names another frame than the message's",
        "Let the detector use one frame for a message",
    ),
    "own_ship_missing": DropReason(
        OWN_SHIP,
        "scan",
        "no own-ship data came within `own_ship_timeout`",
        "Check `own_ship/odometry` (remapped? published? quality of service?), or tf",
    ),
    "own_ship_stale": DropReason(
        OWN_SHIP,
        "scan",
        "own-ship data does not reach to its time within `own_ship_timeout`, or has a gap there",
        "Compare the clocks of sonar and navigation; see `own_ship_timeout`, "
        "`own_ship_max_extrapolation` and `own_ship_max_gap`",
    ),
    "message_corrupt": DropReason(
        DETECTIONS,
        "scan",
        "a message in a bag cannot be read (offline runs only; it may be any topic's)",
        "Record again, or see what wrote the bag",
    ),
    "no_horizontal_range": DropReason(
        DETECTIONS,
        "detection",
        "it lies straight above or below the sonar once roll and pitch are taken out",
        "Nothing, where it is rare; else check the attitude",
    ),
    "heading_unknown": DropReason(
        OWN_SHIP,
        "scan",
        "the own-ship data says that its heading is not known, and the detections need it",
        "Give odometry with a heading, or bearings from north; with those, a coverage all round",
    ),
    "queue_full": DropReason(
        OWN_SHIP,
        "scan",
        "too many scans wait for own-ship data",
        "Shorten `own_ship_timeout`, and see why the data does not come",
    ),
    "own_ship_invalid": DropReason(
        OWN_SHIP,
        "pose",
        "the odometry is not finite, without an orientation, or of no proper covariance",
        "Mend the source; the warning names the field",
    ),
    "own_ship_frame": DropReason(
        OWN_SHIP,
        "pose",
        "the odometry is in another frame than the fixed one",
        "Give `fixed_frame`, or publish in it",
    ),
    "own_ship_empty_frame": DropReason(
        OWN_SHIP,
        "pose",
        "the odometry's `frame_id` is empty",
        "Let the source name one, or give `fixed_frame`",
    ),
    "own_ship_late": DropReason(
        OWN_SHIP,
        "pose",
        "its stamp is not after that of the last",
        "Look for two publishers on one topic",
    ),
    "tracked_bad_id": DropReason(
        TRACKER, "report", "a `track_id` is not an integer from 0 to 2^32 - 1", "Mend the tracker"
    ),
    "tracked_frame": DropReason(
        TRACKER, "report", "it is not in the fixed frame", "Publish in the frame of `tracks`"
    ),
    "tracked_late": DropReason(
        TRACKER, "report", "its stamp is before that of the last", "Look for two trackers"
    ),
    "tracked_stale": DropReason(
        TRACKER,
        "report",
        "its stamp is farther from the scan's than `tracked_timeout`",
        "Stamp with the scan's time; see `tracked_timeout`",
    ),
    "tracked_not_finite": DropReason(
        TRACKER, "target", "its state or covariance is not finite, or too large", "Mend the tracker"
    ),
    "tracked_bad_covariance": DropReason(
        TRACKER, "target", "its covariance is not positive definite", "Mend the tracker"
    ),
    "tracked_duplicate_id": DropReason(
        TRACKER, "target", "its `track_id` is there before", "Mend the tracker"
    ),
    "internal_error": DropReason(
        INITIATION,
        "scan",
        "it could not be placed, processed or published; where the algorithm failed, all tracks "
        "are forgotten",
        "Does the own-ship data jump? Else it is a fault of the node: report the warning's text",
    ),
}

DROP_REASONS: Mapping[str, DropReason] = {
    **dict(_of_layouts()),
    **dict(_of_numbers()),
    **_SINGLE,
}
"""By the name that is counted."""


def reason_of(name: str) -> DropReason:
    """What is known of a reason; one that an adapter of the user counts is a detection's."""
    return DROP_REASONS.get(name) or DropReason(DETECTIONS, "detection", "", "")


def as_markdown() -> str:
    """A table of all reasons for the documentation, in the order of the entries."""
    tasks = (DETECTIONS, OWN_SHIP, TRACKER, INITIATION)
    lines = ["| reason | lost | because | what to do |", "|---|---|---|---|"]
    lines += [
        f"| `{name}` | {reason.lost} | {reason.meaning} | {reason.remedy} |"
        for name, reason in sorted(DROP_REASONS.items(), key=lambda row: tasks.index(row[1].task))
    ]
    return "\n".join(lines) + "\n"
