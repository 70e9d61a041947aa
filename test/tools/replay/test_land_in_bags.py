"""A chart in a bag, offline."""

import numpy as np
from support.bag_files import GRID, PARAMETERS, Entry, grid, simulated, write_bag

from msg_adapters.message_input import MessageInput
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.parameter_files import parse_values
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.replay.bag import Bag, find_topics
from tsepm_ros.tools.replay.offline import bag_results

EVERYTHING = np.ones((100, 100), bool)


def bag(tmp_path, *, topic: str = "/land", frame: str = "odom", time: float = 999.0):
    chart = Entry(time, topic, GRID, grid(time, frame, EVERYTHING, 100.0, -5000.0, -5000.0))
    entries = sorted([*simulated(), chart], key=lambda entry: entry.time)
    return write_bag(tmp_path / "bag", entries)


def run(path, given=None):
    values = {"own_ship_source": "odometry", **parse_values(PARAMETERS)}
    made = make_groups(TRACK_INITIATOR, values)
    session = Session(settings_from(made))
    with Bag(path) as opened:
        topics = find_topics(opened.topics, given or {})
        taken = MessageInput(session, made[InitiatorNodeOptions])
        return list(bag_results(opened, topics, session, taken)), session


def test_a_chart_of_the_bag_is_used(tmp_path):
    results, session = run(bag(tmp_path))
    assert sum(len(result.new) for result in results) == 0
    assert [result.statistics.detections for result in results] == [0] * 10
    assert session.dropped["on_land"] == sum(len(result.scan) for result in results)


def test_a_chart_counts_from_when_it_was_recorded(tmp_path):
    results, _ = run(bag(tmp_path, time=1022.0))
    used = [result.statistics.detections > 0 for result in results]
    assert used == [True] * 5 + [False] * 5


def test_a_chart_in_another_frame_is_refused(tmp_path):
    results, session = run(bag(tmp_path, frame="map"))
    assert session.dropped["land_frame"] == 1
    assert sum(len(result.new) for result in results) >= 2
