"""Messages of one sweep as one scan."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.sensing.arcs import turned
from tsepm_ros.sensing.plots import chosen
from tsepm_ros.sensing.ray_runs import goes_on
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.sensing.sensor import SensorModel

SAME_RAY = 1e-6
"""Difference of azimuths up to which a detection is on a ray, rad."""


def part_of(message: SensorScan, kept: BoolArray) -> SensorScan:
    """Some detections of a message, by a mask (n,)."""

    def of(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[kept]

    return dataclasses.replace(
        message,
        scan=chosen(message.scan, np.flatnonzero(kept)),
        transmit_offset=of(message.transmit_offset),
        height=of(message.height),
    )


def delay(first: SensorScan, message: SensorScan) -> float:
    """Time from the stamp of a message to that of another, s; to the nanosecond, where known."""
    if first.stamp_ns and message.stamp_ns:
        return (message.stamp_ns - first.stamp_ns) / 1e9
    return message.scan.stamp - first.scan.stamp


def joined(
    messages: Sequence[SensorScan], sensor: SensorModel, swept: FloatArray | None
) -> SensorScan:
    """One scan of the detections of messages, each at its own time.

    Parameters
    ----------
    messages : sequence of SensorScan
        At least one, in the order of their stamps, in one frame and of one reference direction.
    sensor : SensorModel
        Errors of the detections of a message that gives none, where another one does.
    swept : (2,) ndarray or None
        As in `Scan`.

    Returns
    -------
    SensorScan
        With the stamp of the first message; a detection's times are those of its message plus the
        time between the two stamps.
    """
    first = messages[0]
    if len(messages) == 1:
        return first if swept is None else _swept(first, swept)
    later = [delay(first, message) for message in messages]
    full = [
        (message, time) for message, time in zip(messages, later, strict=True) if len(message.scan)
    ]
    scans = [message.scan for message, _ in full]

    def all_of(values: Callable[[SensorScan], FloatArray | None]) -> FloatArray:
        parts = [values(message) for message, _ in full]
        return np.concatenate(
            [
                np.zeros(len(scan)) if part is None else part
                for scan, part in zip(scans, parts, strict=True)
            ]
            or [np.zeros(0)]
        )

    def of_scans(values: Callable[[Scan], FloatArray | None]) -> FloatArray:
        return all_of(lambda message: values(message.scan))

    time = np.repeat([time for _, time in full], [len(scan) for scan in scans])
    names = dict.fromkeys(name for scan in scans for name in scan.features)
    own_range = any(scan.range_std is not None for scan in scans)
    own_azimuth = any(scan.azimuth_std is not None for scan in scans)
    scan = Scan.trusted(
        stamp=first.scan.stamp,
        range=of_scans(lambda scan: scan.range),
        azimuth=of_scans(lambda scan: scan.azimuth),
        range_std=of_scans(lambda scan: _range_std(scan, sensor)) if own_range else None,
        azimuth_std=of_scans(lambda scan: _azimuth_std(scan, sensor)) if own_azimuth else None,
        time_offset=time + of_scans(lambda scan: scan.time_offset),
        features={name: of_scans(partial(_feature, name)) for name in names},
        group=_groups(messages, sensor),
        swept=swept,
    )
    heights = any(message.height is not None for message, _ in full)
    return dataclasses.replace(
        first,
        scan=scan,
        transmit_offset=time + all_of(lambda message: message.transmit_offset),
        height=all_of(lambda message: message.height) if heights else None,
        beams=None,
    )


def _swept(message: SensorScan, swept: FloatArray) -> SensorScan:
    return dataclasses.replace(message, scan=dataclasses.replace(message.scan, swept=swept))


def _range_std(scan: Scan, sensor: SensorModel) -> FloatArray:
    own = scan.range_std
    return np.sqrt(sensor.range_variance(scan.range)) if own is None else own


def _azimuth_std(scan: Scan, sensor: SensorModel) -> FloatArray:
    own = scan.azimuth_std
    return np.full(len(scan), sensor.azimuth_std) if own is None else own


def _feature(name: str, scan: Scan) -> FloatArray:
    return scan.features.get(name, np.full(len(scan), np.nan))


def _groups(messages: Sequence[SensorScan], sensor: SensorModel) -> IntArray | None:
    """Groups of all detections; runs of rays go on from one message to the next."""
    if all(message.scan.group is None for message in messages):
        return None
    groups, following = [np.zeros(0, np.int64)], 0
    for before, message in zip([None, *messages[:-1]], messages, strict=True):
        group = message.scan.group
        if group is None or not len(group):
            groups.append(np.full(len(message.scan), -1))
            continue
        own = np.where(group < 0, -1, group - group.min() + following)
        if before is not None and group.min() >= 0 and _continues(before, message, sensor):
            own = own - 1 + (following - own[0])
        groups.append(own)
        following = int(own.max(initial=following - 1)) + 1
    return np.concatenate(groups)


def _continues(before: SensorScan, after: SensorScan, sensor: SensorModel) -> bool:
    """Whether the last ray of a message and the first of the next see one object."""
    one, two = before.beams, after.beams
    if one is None or two is None or before.scan.group is None or not len(before.scan):
        return False
    # Of the first and last beams of both, the two that are next to each other.
    edges = [
        (end, begin)
        for end in (one.start, one.start + one.width)
        for begin in (two.start, two.start + two.width)
    ]
    end, begin = min(edges, key=lambda pair: abs(turned(pair[1] - pair[0])))
    last, first = float(before.scan.azimuth[-1]), float(after.scan.azimuth[0])
    if max(abs(turned(last - end)), abs(turned(first - begin))) > SAME_RAY:
        return False
    rays = before.scan.range[-1:], after.scan.range[:1]
    return bool(goes_on(*rays, turned(first - last), sensor)[0])
