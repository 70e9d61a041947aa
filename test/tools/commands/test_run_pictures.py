"""Pictures and animations of `tsepm run`."""

import numpy as np
import pytest

from tsepm_ros.tools.commands.cli import main


@pytest.mark.long
def test_a_run_is_drawn_by_one_command(scenario, tmp_path):
    pytest.importorskip("matplotlib")
    from PIL import Image

    from tsepm_ros.tools.pictures.plan_position import FRAME_TIME, LAST_FRAME_TIME

    picture, animation = tmp_path / "run.png", tmp_path / "run.gif"
    assert main(["run", scenario, "--picture", str(picture), "--animation", str(animation)]) == 0
    assert np.ptp(np.asarray(Image.open(picture))) > 100
    with Image.open(animation) as frames:
        shown = 0
        for number in range(frames.n_frames):
            frames.seek(number)
            shown += frames.info["duration"]
    assert shown == FRAME_TIME * 7 + LAST_FRAME_TIME, "ms"
    assert animation.stat().st_size < 3e6


def test_a_long_run_is_animated_in_steps_that_end_with_the_last_scan(tmp_path):
    pytest.importorskip("matplotlib")
    from PIL import Image

    from tsepm_ros.tools.pictures.plan_position import (
        FRAME_TIME,
        LAST_FRAME_TIME,
        animate,
        shown_scans,
    )
    from tsepm_ros.tools.pictures.run_scene import RunScene, ScanView
    from tsepm_ros.tracker.tracks import TrackArrays

    assert list(shown_scans(8, 3)) == [1, 4, 7]
    assert list(shown_scans(8, 8)) == list(range(8))
    nothing = TrackArrays.of([])
    views = [ScanView(float(k), np.zeros((0, 2)), None, nothing, nothing) for k in range(8)]
    assert animate(RunScene("run", views), tmp_path / "run.gif", max_frames=3) == 3
    with Image.open(tmp_path / "run.gif") as frames:
        shown = 0
        for number in range(frames.n_frames):
            frames.seek(number)
            shown += frames.info["duration"]
    assert shown == FRAME_TIME * 2 + LAST_FRAME_TIME


def test_the_truth_of_a_bag_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    bag_files = pytest.importorskip("support.bag_files")
    from msg_adapters.track_cloud import TRACK_DTYPE
    from tsepm_ros.tools.replay.bag import Bag, find_topics
    from tsepm_ros.tools.replay.offline import bag_truth

    entries = bag_files.simulated()
    for stamp in (1000.0, 1010.0):
        values = {name: [0.0] for name in TRACK_DTYPE.names}
        values |= {"track_id": [3.0], "state_x": [stamp], "state_y": [-stamp]}
        message = bag_files.cloud(stamp, "odom", **values)
        entries.append(bag_files.Entry(stamp, "/ground_truth", bag_files.POINTS, message))
    other = bag_files.cloud(1005.0, "odom", colour=[1.0])  # no truth, and left out
    entries.append(bag_files.Entry(1005.0, "/ground_truth", bag_files.POINTS, other))
    path = bag_files.write_bag(tmp_path / "bag", sorted(entries, key=lambda e: e.time))
    with Bag(path) as bag:
        (truth,) = bag_truth(bag, find_topics(bag.topics, {}))
    assert truth == pytest.approx(np.array([[1000.0, 1000.0, -1000.0], [1010.0, 1010.0, -1010.0]]))
    assert main(["run", str(path), "--picture", str(tmp_path / "a.png")]) == 0
    assert (tmp_path / "a.png").stat().st_size > 10_000
