"""From what the adapters read to what a session takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msg_adapters.detections import DetectionMessage
from msg_adapters.own_ship_odometry import OwnShipSample
from msg_adapters.stamps import ns_to_seconds, time_to_ns
from msg_adapters.track_cloud import read_track_cloud, track_arrays
from tsepm_ros.maintenance.downstream_tracker import TrackerReport
from tsepm_ros.own_ship.pose_history import PoseSample, known_rates
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.sensing.scan import Scan

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2


def sensor_scan(detections: DetectionMessage) -> SensorScan:
    """A detection message as a scan that is not yet placed."""
    return SensorScan(
        scan=Scan(
            stamp=ns_to_seconds(detections.stamp_ns),
            range=detections.range,
            azimuth=detections.azimuth,
            range_std=detections.range_std,
            azimuth_std=detections.azimuth_std,
            time_offset=detections.time_offset,
            features=detections.features,
        ),
        frame_id=detections.frame_id,
        north_referenced=detections.north_referenced,
        transmit_offset=detections.transmit_offset,
        height=detections.height,
        axes=detections.axes,
        stamp_ns=detections.stamp_ns,
    )


def pose_sample(sample: OwnShipSample) -> PoseSample:
    """An own-ship message as a pose; a velocity or yaw rate of exactly 0 counts as not given."""
    return PoseSample(
        stamp=ns_to_seconds(sample.stamp_ns),
        x=sample.x,
        y=sample.y,
        yaw=sample.yaw,
        covariance=sample.pose_covariance,
        rates=known_rates(sample.vx, sample.vy, sample.yaw_rate),
        roll=sample.roll,
        pitch=sample.pitch,
    )


def tracker_report(cloud: PointCloud2) -> TrackerReport:
    """A cloud of tracks as what a downstream tracker says that it tracks.

    Raises
    ------
    MessageError
        If it has not the layout of `read_track_cloud`.
    """
    stamp = ns_to_seconds(time_to_ns(cloud.header.stamp))
    tracks = track_arrays(read_track_cloud(cloud), stamp)
    return TrackerReport(stamp=stamp, frame_id=cloud.header.frame_id, tracks=tracks)
