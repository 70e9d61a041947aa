"""Every method in the node, on the scene of the demonstration."""

import pytest
from sensor_msgs.msg import PointCloud2
from support.patience import patient
from support.ros_world import LATCHED
from support.sonar_driver import points, stamp_ns

from tsepm_ros import available_methods
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator
from tsepm_ros.tools.simulation import load_scenario


@pytest.mark.parametrize("method", available_methods())
def test_every_method_answers_every_ping_of_the_demo(world, method):
    scene = load_scenario("four_targets")
    world.deadline = patient(10.0)
    tracks = world.listen(PointCloud2, "tracks")
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    given = {"own_ship_source": "odometry", "own_ship_timeout": 60.0, "diagnostics_period": 0.05}
    world.make(TrackInitiator, {"method": method, "max_scan_time": 3600.0, **given})
    simulated = {"seed": 2, "rate_factor": 300.0, "own_ship_rate": 0.25, "wait_for_subscribers": 1}
    world.make(SonarSimulator, simulated)
    world.until(lambda: len(current) == scene.scans, "an answer to every ping")
    stamps = [stamp_ns(message) for message in tracks]
    assert (len(stamps), stamps) == (scene.scans, sorted(set(stamps)))
    assert world.dropped() == {}
    if method not in ("heuristic", "modified_hough"):  # limits as printed: nothing is found
        assert sum(len(points(message)) for message in tracks) > 0
