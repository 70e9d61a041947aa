"""Placing a scan in the fixed frame: levelled, and with the sensor's pose at each echo.

What the sensor measured along its own axes becomes range and azimuth in the horizontal plane, and
the vessel's poses become those of the sensor, which is mounted somewhere on it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.attitude import horizontal_range_rate, levelled
from tsepm_ros.own_ship.mounting import Mounting, sensor_covariance
from tsepm_ros.own_ship.pose_history import PoseHistory, echo_poses
from tsepm_ros.sensing.scan import LARGEST, SMALLEST, Scan, wrap


@dataclass(frozen=True)
class SensorScan:
    """A scan as it arrives: not yet placed in the fixed frame.

    Attributes
    ----------
    scan : Scan
        Detections; its sensor pose is not used. The ranges are those in the sensor's own x-y
        plane; range rates are along the slant line of sight.
    frame_id : str
        The sensor's frame.
    north_referenced : bool
        The azimuths count from the fixed frame's x axis (east), not from the sensor's, and lie in
        the horizontal plane: neither heading nor attitude is applied to them.
    stamp_ns : int
        The stamp as received, ns: a date in seconds does not fit a float64 to the last digit.
    transmit_offset : (n,) ndarray or None
        Time after the stamp at which each detection's ping left, s; None: at the stamp.
    height : (n,) ndarray or None
        Height of each detection above the sensor's own x-y plane, m; None: 0.
    axes : str
        Which of the sensor frame's axes are ahead, port and up, see `attitude.AXES`.
    """

    scan: Scan
    frame_id: str
    north_referenced: bool = False
    stamp_ns: int = 0
    transmit_offset: FloatArray | None = None
    height: FloatArray | None = None
    axes: str = "body"


def at_rest(arrived: SensorScan) -> Scan:
    """Place a scan of a level sensor that stays at the origin of the fixed frame."""
    return _chosen(arrived, arrived.scan.range, arrived.scan.azimuth).scan


def to_fixed_frame(
    arrived: SensorScan, poses: PoseHistory, mounting: Mounting, *, sector: bool = False
) -> Scan:
    """Place a scan by the poses of its echoes.

    Parameters
    ----------
    arrived : SensorScan
    poses : PoseHistory
        Of the vessel; it must cover `echo_span`.
    mounting : Mounting
        Of the sensor on it.
    sector : bool, optional
        Whether azimuths from north are turned to the sensor's axes, by the heading at reception:
        its coverage is a sector of them. Positions and their covariances are the same.

    Returns
    -------
    Scan
        Without the detections that lie straight above or below the tilted sensor. Range rates are
        nan where the sensor's velocity is not known, or beyond what `LARGEST` allows (poses that
        jump): measured against that, they say nothing.

    Raises
    ------
    ValueError
        If a time is beyond what the poses cover.
    """
    arrived = _levelled(arrived, poses, mounting)
    scan = arrived.scan
    heading = not arrived.north_referenced
    velocity, features = np.zeros(2), scan.features
    if "range_rate" in features:
        velocity = _sensor_velocity(arrived, poses, mounting)
        known = np.asarray((np.abs(velocity) <= LARGEST["sensor_velocity"]).all(axis=-1))
        velocity = np.where(known[..., None], velocity, 0.0)
        features = {**features, "range_rate": np.where(known, features["range_rate"], np.nan)}
    placed = scan.replaced(
        features=features,
        sensor_pose=echo_poses(
            lambda times: _sensor_poses(times, poses, mounting),
            scan.stamp,
            scan.time_offset,
            scan.azimuth,
            transmit_offset=arrived.transmit_offset,
            heading=heading,
        ),
        sensor_pose_covariance=_sensor_covariance(scan.stamp, poses, mounting, heading),
        sensor_velocity=velocity,
    )
    if heading or not sector:
        return placed
    return _by_the_sensor(placed, _received(arrived), poses, mounting)


def echo_span(arrived: SensorScan) -> tuple[float, float]:
    """Time from the transmit to the last echo's arrival, s, for which poses are needed."""
    scan = arrived.scan
    if scan.time_offset is None or not len(scan):
        return scan.stamp, scan.stamp
    sent = np.zeros(1) if arrived.transmit_offset is None else arrived.transmit_offset
    times = np.concatenate([[0.0], sent, 2.0 * scan.time_offset - sent])
    return scan.stamp + float(times.min()), scan.stamp + float(times.max())


def _received(arrived: SensorScan) -> FloatArray:
    """Times at which the echoes arrived, s, (n,) or, where all arrived at once, (1,)."""
    scan = arrived.scan
    if scan.time_offset is None:
        return np.array([scan.stamp])
    sent = 0.0 if arrived.transmit_offset is None else arrived.transmit_offset
    return scan.stamp + 2.0 * scan.time_offset - sent


def _chosen(arrived: SensorScan, range: FloatArray, azimuth: FloatArray) -> SensorScan:
    """A scan's detections at the horizontal ranges and azimuths given, as far as those are good."""
    scan = arrived.scan
    if range is scan.range and (arrived.height is None or "range_rate" not in scan.features):
        return arrived
    good = (range >= SMALLEST["range"]) & (range <= LARGEST["range"])

    def of(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[good]

    features = dict(scan.features)
    if "range_rate" in features:
        height = 0.0 if arrived.height is None else arrived.height
        slant = np.hypot(scan.range, height)
        features["range_rate"] = horizontal_range_rate(features["range_rate"], slant, range)
    chosen = Scan.trusted(
        stamp=scan.stamp,
        range=range[good],
        azimuth=wrap(azimuth[good]),
        range_std=of(scan.range_std),
        azimuth_std=of(scan.azimuth_std),
        time_offset=of(scan.time_offset),
        features={name: values[good] for name, values in features.items()},
    )
    return dataclasses.replace(
        arrived, scan=chosen, transmit_offset=of(arrived.transmit_offset), height=None
    )


def _sensor_poses(times: FloatArray, poses: PoseHistory, mounting: Mounting) -> FloatArray:
    """Poses of the sensor at some times (s), (n, 3)."""
    return mounting.sensor_poses(poses.poses_with_attitude(times))


def _by_the_sensor(
    scan: Scan, received: FloatArray, poses: PoseHistory, mounting: Mounting
) -> Scan:
    """A placed scan with azimuths from north as one with the sensor's azimuths and yaws."""
    pose = np.array(scan.sensor_pose)
    at_once = pose.ndim == 1
    times = np.array([scan.stamp]) if at_once else received
    yaw = _sensor_poses(times, poses, mounting)[:, 2]
    pose[..., 2] = yaw[0] if at_once else yaw
    return scan.replaced(azimuth=scan.azimuth - yaw, sensor_pose=pose)


def _arm(times: FloatArray, poses: PoseHistory, mounting: Mounting) -> FloatArray:
    """From the vessel's origin to the sensor in the fixed frame's axes, m, (n, 2)."""
    vessel = poses.poses_with_attitude(times)
    return mounting.sensor_poses(vessel)[:, :2] - vessel[:, :2]


def _sensor_velocity(arrived: SensorScan, poses: PoseHistory, mounting: Mounting) -> FloatArray:
    """Velocity of the sensor when each echo was reflected, m/s, (n, 2), or (2,) for all."""
    scan = arrived.scan
    times = scan.stamp + (np.zeros(1) if scan.time_offset is None else scan.time_offset)
    rates = poses.rates(times, echo_span(arrived)[1])
    velocity = rates[:, :2]
    if mounting.offset:
        arm = _arm(times, poses, mounting)
        velocity = velocity + rates[:, 2:] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    return velocity[0] if scan.time_offset is None else velocity


def _sensor_covariance(
    stamp: float, poses: PoseHistory, mounting: Mounting, heading: bool
) -> FloatArray | None:
    """Covariance of the sensor's pose at a stamp (s), from the vessel's."""
    covariance = poses.covariance(stamp)
    if covariance is None:
        return None
    if mounting.offset:
        covariance = sensor_covariance(covariance, _arm(np.array([stamp]), poses, mounting)[0])
    return covariance if heading else covariance * np.outer([1, 1, 0], [1, 1, 0])


def _levelled(arrived: SensorScan, poses: PoseHistory, mounting: Mounting) -> SensorScan:
    """Bring a scan into the horizontal plane, by the attitude with which it was received."""
    scan = arrived.scan
    range_, azimuth = scan.range, scan.azimuth
    if not arrived.north_referenced:
        _, _, _, roll, pitch = poses.poses_with_attitude(_received(arrived)).T
        range_, azimuth = levelled(range_, azimuth, arrived.height, roll, pitch, mounting.yaw)
    return _chosen(arrived, range_, azimuth)
