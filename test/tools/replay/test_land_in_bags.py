"""A chart in a bag, offline."""

import numpy as np
import pytest
from support.bag_files import GRID, PARAMETERS, Entry, grid, simulated, write_bag

from msg_adapters.message_input import MessageInput
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.parameter_files import parse_values
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.replay.bag import Bag, find_topics
from tsepm_ros.tools.replay.offline import bag_results

EVERYTHING = np.ones((100, 100), bool)


def bag(tmp_path, time: float):
    chart = Entry(time, "/land", GRID, grid(time, "odom", EVERYTHING, 100.0, -5000.0, -5000.0))
    entries = sorted([*simulated(), chart], key=lambda entry: entry.time)
    return write_bag(tmp_path / "bag", entries)


def run(path):
    values = {"own_ship_source": "odometry", **parse_values(PARAMETERS)}
    made = make_groups(TRACK_INITIATOR, values)
    session = Session(settings_from(made))
    with Bag(path) as opened:
        topics = find_topics(opened.topics, {})
        taken = MessageInput(session, made[InitiatorNodeOptions])
        return list(bag_results(opened, topics, session, taken)), session


@pytest.mark.parametrize(("time", "before"), [(999.0, 0), (1022.0, 5)])
def test_a_chart_counts_from_when_it_was_recorded(tmp_path, time, before):
    results, session = run(bag(tmp_path, time))
    used = [result.statistics.detections > 0 for result in results]
    assert used == [True] * before + [False] * (10 - before)
    assert session.dropped["on_land"] == sum(len(result.scan) for result in results[before:])
