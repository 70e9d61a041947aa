"""Messages taken in one thread, and shown to a browser by the server's."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest
from support.pages import Watcher, held
from support.patience import WAIT

from tsepm_ros.tools.viewer.live_frames import DIAGNOSTICS

pytest.importorskip("tornado")
pytest.importorskip("sensor_msgs")

from msg_adapters import make_header, odometry_message, track_cloud
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.settings.node_options import ViewerNodeOptions
from tsepm_ros.tools.viewer.live_frames import OWN_SHIP, TRACKS, LiveFeed


def tracks(stamp: float, *held_tracks):
    return track_cloud(make_header(round(stamp * 1e9), "odom"), list(held_tracks))


def pose(x: float) -> PoseSample:
    return PoseSample(100.0, x, 2.0, 0.5, None, frame_id="odom")


class Feed(LiveFeed):
    def __init__(self) -> None:
        self.reported: list[str] = []
        self.poses_read: list[PoseSample] = []

        def read(sample: PoseSample):
            self.poses_read.append(sample)
            return odometry_message(sample)

        options = ViewerNodeOptions(port=0)
        super().__init__(options, "Tracks", "/tracks/current", self.reported.append, read)


@pytest.fixture
def feed() -> Iterator[Feed]:
    one = Feed()
    yield one
    one.server.stop()


@pytest.fixture
def browser(feed) -> Iterator[Watcher]:
    with Watcher(feed.server.url) as watcher:
        yield watcher


def wait_for(condition: Callable[[], object]) -> None:
    end = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_scan_is_shown_with_the_newest_pose_and_only_that_is_read(feed, browser):
    broken = tracks(99.0, held(7, 10.0, 20.0))
    broken.fields = broken.fields[:2]
    feed.take(TRACKS, broken)
    for x in (1.0, 2.0, 3.0):
        feed.take(OWN_SHIP, pose(x))
    feed.take(TRACKS, tracks(100.0, held(7, 10.0, 20.0)))
    wait_for(lambda: browser.frames)
    (frame,) = browser.frames
    assert frame["own_ship"][:2] == [300, 200]  # cm
    assert [row[0] for row in frame["tracks"]] == [7]
    assert [sample.x for sample in feed.poses_read] == [3.0]
    (sentence,) = feed.reported
    assert sentence.startswith(f"a message on {TRACKS} cannot be shown: ")
    feed.take(TRACKS, tracks(112.0))
    wait_for(lambda: len(browser.frames) == 2)
    assert len(feed.poses_read) == 1


def test_a_browser_is_told_only_of_changes_of_what_is_published(feed, browser):
    def told() -> list[bool]:
        infos = [update.get("info", {}) for update in browser.updates]
        return [info["published"] for info in infos if "published" in info]

    wait_for(lambda: browser.updates)
    for known in (False, True):
        feed.published(known)
        wait_for(lambda known=known: told()[-1:] == [known])
        feed.published(known)
    feed.take(TRACKS, tracks(100.0))
    wait_for(lambda: browser.frames)
    assert told() == [False, True]


def diagnostics(name: str, message: str):
    status = SimpleNamespace(name=name, level=1, message=message, values=[])
    return SimpleNamespace(status=[status])


def test_health_is_that_of_the_track_initiator(feed, browser):
    feed.take(DIAGNOSTICS, diagnostics("boat: own ship", "no data yet"))
    wait_for(lambda: browser.health)
    feed.take(DIAGNOSTICS, diagnostics("battery: charge", "empty"))
    feed.take(TRACKS, tracks(100.0))
    wait_for(lambda: browser.frames)
    assert [entry["message"] for entry in browser.health["entries"]] == ["no data yet"]
