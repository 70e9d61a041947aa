"""SROS 2: the policy is what the nodes use, and without its libraries no node runs unprotected."""

import os
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tsepm_ros.nodes.sonar_detector import SonarDetector
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator

POLICY = Path(__file__).parents[2] / "config" / "sros2" / "tsepm_ros.policy.xml"
EVERYTHING = {
    "track_initiator": {"own_ship_source": "odometry", "publish_potential_tracks": True},
    "sonar_detector": {},
    "sonar_simulator": {"publish_clock": True},
    "scan_player": {"publish_clock": True},
    "track_viewer": {"port": 0},
    "track_bridge": {"nmea_address": ""},
}
"""Parameters with which a node has all of its topics but `UNSEEN`."""
UNSEEN = {"/tf", "/tf_static", "/clock", "/tracks/objects", "/tracks/radar", "/image/plan"}
"""Topics of tf, of simulated time, of packages that are not installed, and of a browser's wish."""

pytestmark = pytest.mark.skipif(not POLICY.exists(), reason="only in the source tree")


def allowed(node: str) -> dict[str, set[str]]:
    """Fully qualified names that the policy allows a node, by what it does with them."""
    root = ElementTree.parse(POLICY).getroot()
    (profile,) = root.findall(f".//enclave[@path='/tsepm_ros/{node}']/profiles/profile")
    assert (profile.get("ns"), profile.get("node")) == ("/", node)
    names: dict[str, set[str]] = {
        what: set() for what in ("publish", "subscribe", "reply", "request")
    }
    for group in (*profile.findall("topics"), *profile.findall("services")):
        ((what, value),) = group.attrib.items()
        assert value == "ALLOW"
        names[what] |= {
            text.replace("~", f"/{node}") if text[0] in "~/" else f"/{text}"
            for text in (str(element.text) for element in group)
        }
    return names


@pytest.mark.parametrize("name", EVERYTHING)
def test_the_policy_allows_a_node_exactly_its_topics_and_services(world, tmp_path, name):
    (tmp_path / "detections.csv").write_text("time_s,range_m,azimuth_rad\n0,100,0\n1,100,0\n")
    (tmp_path / "own_ship.csv").write_text("time_s,east_m,north_m\n0,0,0\n1,0,0\n")
    kinds = {
        "track_initiator": TrackInitiator,
        "sonar_detector": SonarDetector,
        "sonar_simulator": SonarSimulator,
        "scan_player": ScanPlayer,
    }
    if name == "track_viewer":
        pytest.importorskip("tornado")
        from tsepm_ros.tools.viewer.track_viewer import TrackViewer

        kinds["track_viewer"] = TrackViewer
    if name == "track_bridge":
        pytest.importorskip("pyproj")
        from tsepm_ros.tools.bridge.track_bridge import TrackBridge

        kinds["track_bridge"] = TrackBridge
    more = {"recording": str(tmp_path)} if name == "scan_player" else {}
    others = [] if name == "sonar_simulator" else [world.make(SonarSimulator)]
    node = world.make(kinds[name], {**EVERYTHING[name], **more})
    of = world.observer
    found: dict[str, set[str]] = {}

    def complete() -> bool:
        found["publish"] = {x for x, _ in of.get_publisher_names_and_types_by_node(name, "/")}
        found["subscribe"] = {x for x, _ in of.get_subscriber_names_and_types_by_node(name, "/")}
        found["reply"] = {x for x, _ in of.get_service_names_and_types_by_node(name, "/")}
        found["request"] = {x for x, _ in of.get_client_names_and_types_by_node(name, "/")}
        policy = allowed(name)
        assert all(found[what] <= policy[what] for what in policy)
        return all(policy[what] - UNSEEN <= found[what] for what in policy)

    world.until(complete, f"everything of {node.get_name()} that the policy allows")
    assert len(others) <= 1


def test_security_that_cannot_be_had_ends_the_node_with_a_sentence(start, monkeypatch, tmp_path):
    monkeypatch.setitem(os.environ, "ROS_SECURITY_ENABLE", "true")
    monkeypatch.setitem(os.environ, "ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setitem(os.environ, "ROS_SECURITY_KEYSTORE", str(tmp_path))
    process = start("track_initiator", {})
    assert process.exit_code() == 2
    assert "Traceback" not in process.said
    (line,) = [line for line in process.said.splitlines() if line.startswith("refused:")]
    assert "secur" in line.lower()
