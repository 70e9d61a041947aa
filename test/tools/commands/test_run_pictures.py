"""Pictures of `tsepm run`."""

import numpy as np
import pytest

from tsepm_ros.tools.commands.cli import main


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
