"""A sonar on a moving ship: scans are placed by odometry, and odometry that is bad is dropped."""

import math

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2
from support.boat import Boat
from support.expectation import STATE, confirmed
from support.ros_world import BEST_EFFORT, LATCHED, RELIABLE
from support.ship import MOVING, SECOND, TARGET, TURNING, at, publish_poses, seen_from
from support.sonar_driver import START_NS, Driver, Ping, pings, points, stamp_ns

from msg_adapters import make_header

SENT = pings(12)


@pytest.mark.parametrize(
    ("ship", "qos"),
    [(MOVING, RELIABLE), (TURNING, BEST_EFFORT)],
    ids=["moving", "turning, best effort"],
)
def test_tracks_are_in_the_odometrys_frame_wherever_the_ship_goes(world, ship, qos):
    boat = Boat(world, own_ship_source="odometry")
    world.end(boat.driver)
    boat.driver = world.add(Driver(world.context, odometry_qos=qos))
    boat.connect()
    world.until(boat.driver.odometry.get_subscription_count, "the node to read the odometry")
    publish_poses(boat, ship, 0, 61, step=0.25)
    for index in range(6):
        time = 12.0 * index
        distance, azimuth = seen_from(ship, time, *at(TARGET, time))
        boat.driver.ping(Ping(START_NS + round(time * SECOND), [distance], [azimuth]))
    received = boat.take(6, 0)
    [(message, point)] = [(one, p) for one in received for p in points(one)]
    assert message.header.frame_id == "odom"
    time = (stamp_ns(message) - START_NS) / SECOND
    x, y = at(TARGET, time)
    assert math.hypot(point["x"] - x, point["y"] - y) < 2.0
    assert math.hypot(point["state_vx"] - TARGET[1], point["state_vy"] - TARGET[3]) < 0.1


def test_tracks_of_odometry_in_a_ned_frame_are_in_its_axes(world):
    """A ship that heads east: yaw 90 degrees from north, x ahead and z down."""
    boat = Boat(world, own_ship_source="odometry", publish_potential_tracks=True)
    placed = world.listen(PointCloud2, "detections/placed")
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    world.until_connected()
    for second in range(0, 140, 4):
        pose = Odometry(child_frame_id="base_link_ned")
        pose.header = make_header(START_NS + second * SECOND, "world_ned")
        pose.pose.pose.position.x, pose.pose.pose.position.y = 50.0, 20.0
        turned = pose.pose.pose.orientation
        turned.z = turned.w = math.sqrt(0.5)
        boat.driver.odometry.publish(pose)
    received = boat.send(SENT)
    expected = [track for tracks in confirmed(SENT) for track in tracks]
    found = [point for message in received for point in points(message)]
    assert {message.header.frame_id for message in received} == {"world_ned"}
    assert len(found) == len(expected) > 0
    for point, track in zip(found, expected, strict=True):
        x, vx, y, vy = track.state
        north_east = [point[name] for name in STATE]
        np.testing.assert_allclose(north_east, [y + 50.0, vy, x + 20.0, vx], atol=1e-6)
        assert point["cov_00"] == pytest.approx(track.covariance[2, 2])
        assert point["cov_02"] == pytest.approx(track.covariance[2, 0])
    world.until(lambda: len(placed) == len(SENT) and current, "the other topics")
    range_, azimuth = np.array(SENT[-1].range), np.array(SENT[-1].azimuth)
    north = [row["position_x"] for row in points(placed[-1])]  # without the bias of azimuth errors
    np.testing.assert_allclose(north, 50.0 + range_ * np.sin(azimuth), rtol=3e-4)
