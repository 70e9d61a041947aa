"""What a downstream tracker says on `tracked`, and what comes of it on `tracks/current`."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField
from support.boat import Boat
from support.expectation import COVARIANCE, STATE
from support.ros_world import BEST_EFFORT, LATCHED, RELIABLE, WARN, World
from support.sonar_driver import START_NS, Ping, cloud, points, stamp_ns
from visualization_msgs.msg import Marker, MarkerArray

from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks, Status

SECOND = 10**9
DATATYPES = {
    **dict.fromkeys(("x", "y", "z"), PointField.FLOAT32),
    "track_id": PointField.UINT32,
    **dict.fromkeys((*STATE, *COVARIANCE, "evaluation", "score"), PointField.FLOAT64),
    **dict.fromkeys(("hit_count", "scan_count"), PointField.UINT16),
    "age": PointField.FLOAT64,
}
"""The layout of tracks, as the topic table has it."""


class Tracker:
    """A downstream tracker, and what the node then holds."""

    def __init__(self, world: World, boat: Boat, qos=RELIABLE) -> None:
        self.world, self.boat = world, boat
        self.publisher = world.observer.create_publisher(PointCloud2, "tracked", qos)
        self.current = world.listen(PointCloud2, "tracks/current", LATCHED)
        self.markers = world.listen(MarkerArray, "tracks/markers")
        world.until(self.publisher.get_subscription_count, "the node to subscribe to tracked")
        world.until_connected()

    def say(self, after: float, *ids: int, frame_id: str = "sonar", sigma: float = 50.0) -> None:
        """Say at some time (s) what is tracked: targets at 2 m/s along y."""
        values = {name: np.zeros(len(ids)) for name in DATATYPES}
        values["track_id"] = np.array(ids)
        values["state_x"] = np.full(len(ids), 7000.0)
        values["state_y"] = 2.0 * after + 1000.0 * np.arange(len(ids))
        values["state_vy"] = np.full(len(ids), 2.0)
        for place in range(4):
            values[f"cov_{place}{place}"] = np.full(len(ids), (sigma if place % 2 == 0 else 1) ** 2)
        stamp = START_NS + round(after * SECOND)
        self.publish(cloud(stamp, values, frame_id=frame_id, datatypes=DATATYPES))

    def publish(self, message: PointCloud2) -> None:
        """Publish, and wait until the node has it."""
        [subscription] = [
            one for one in self.boat.node.subscriptions if one.topic_name == "/tracked"
        ]
        take, taken = subscription.callback, []

        def take_and_note(message: PointCloud2) -> None:
            take(message)
            taken.append(message)

        subscription.callback = take_and_note
        self.publisher.publish(message)
        self.world.until(lambda: taken, "the node to take it")
        subscription.callback = take

    def held_at(self, after: float) -> list[dict[str, float]]:
        """What is held at an empty ping at some time (s)."""
        stamp = START_NS + round(after * SECOND)
        self.boat.send([Ping(stamp, [], [])])
        self.world.until(
            lambda: self.current and stamp_ns(self.current[-1]) == stamp, "the current tracks"
        )
        return points(self.current[-1])

    def shown_at(self, after: float) -> tuple[set[int], set[int]]:
        """Ids that the markers of a ping show and delete."""
        stamp = START_NS + round(after * SECOND)

        def of_ping() -> list[Marker]:
            return [
                one for array in self.markers for one in array.markers if stamp_ns(one) == stamp
            ]

        self.world.until(of_ping, "markers")
        return tuple(
            {one.id for one in of_ping() if one.action == action}
            for action in (Marker.ADD, Marker.DELETE)
        )


def ids(held: list[dict[str, float]]) -> list[float]:
    return [point["track_id"] for point in held]


@pytest.mark.parametrize("qos", [RELIABLE, BEST_EFFORT], ids=["reliable", "best_effort"])
def test_what_is_tracked_is_held_carried_and_ended_as_the_tracker_says(world, qos):
    boat = Boat(world)
    tracker = Tracker(world, boat, qos)
    tracker.say(0.0, 2**31, 2**31 + 1)
    one, two = tracker.held_at(12.0)
    assert ids([one, two]) == [2**31, 2**31 + 1]
    np.testing.assert_allclose([one[name] for name in STATE], [7000.0, 0.0, 24.0, 2.0])
    assert one["cov_22"] > 50.0**2 + 12.0**2
    assert tracker.shown_at(12.0) == ({-(2**31), -(2**31) + 1}, set())
    tracker.say(13.0, 2**31 + 1)
    assert ids(tracker.held_at(24.0)) == [2**31 + 1]
    assert tracker.shown_at(24.0) == ({-(2**31) + 1}, {-(2**31)})
    tracker.say(25.0)
    assert tracker.held_at(36.0) == []
    assert world.dropped() == {}


def test_the_markers_of_a_track_that_is_not_published_any_more_are_deleted(world, monkeypatch):
    boat = Boat(world)
    tracker = Tracker(world, boat)
    tracker.say(0.0, 7, 8)
    assert ids(tracker.held_at(12.0)) == [7, 8]
    monkeypatch.setattr(ConfirmedTracks, "statuses", lambda held, *_: np.array([Status.FIXED, 0]))
    assert ids(tracker.held_at(24.0)) == [8]
    assert tracker.shown_at(24.0) == ({8}, {7})
    figures = world.figures()
    assert (figures["tracks.published"], figures["tracks.fixed"]) == ("1", "1")
    monkeypatch.undo()
    tracker.say(25.0, 8)
    assert ids(tracker.held_at(36.0)) == [8]
    world.until(lambda: world.figures().get("ended.tracker") == "1", "the end to be counted")
    assert tracker.held_at(48.0)
    assert world.figures()["ended.tracker"] == "1", "ends are counted since the start"
    world.until_logged("track 7 ended: the downstream tracker does not list it", level=20)


def test_a_tracker_that_falls_silent_and_comes_back_is_said(world):
    tracker = Tracker(world, Boat(world, tracked_timeout=20.0))
    tracker.say(20.0, 9)  # ahead of the ping: carried back
    [track] = tracker.held_at(12.0)
    np.testing.assert_allclose([track[name] for name in STATE], [7000.0, 0.0, 24.0, 2.0])
    assert world.figures()["tracker"] == "alive"
    assert ids(tracker.held_at(48.0)) == [9], "held here now"
    world.until_logged("downstream tracker was silent for 20 s", level=WARN)
    assert "silent" in world.status("downstream tracker").message
    assert world.figures()["tracker"] == "silent"
    tracker.say(49.0, 9)
    assert ids(tracker.held_at(60.0)) == [9]
    world.until_logged("downstream tracker reports again")
    assert world.figures()["tracker"] == "alive"


def test_messages_that_cannot_be_used_are_dropped_counted_and_said(world):
    tracker = Tracker(world, Boat(world))
    tracker.held_at(0.0)
    tracker.say(1.0, 9)
    tracker.publish(cloud(START_NS + 2 * SECOND, {"x": [1.0], "y": [2.0], "z": [0.0]}))
    tracker.publish(PointCloud2())
    tracker.say(3.0, 10, frame_id="map")
    assert ids(tracker.held_at(12.0)) == [9]
    tracker.say(13.0, 9, 9)
    assert ids(tracker.held_at(24.0)) == [9]
    tracker.say(25.0, 9, sigma=float("nan"))
    assert ids(tracker.held_at(36.0)) == []
    assert world.dropped() == {
        "tracked_missing_field": 2,
        "tracked_frame": 1,
        "tracked_duplicate_id": 1,
        "tracked_not_finite": 1,
    }
    world.until_logged("tracked targets dropped", "'track_id' is missing", level=WARN)
    world.until_logged("tracked targets are in frame 'map'", level=WARN)
