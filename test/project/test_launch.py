# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""What the launch file starts, read by the rules of `launch`, which does not come as a wheel."""

import re
import shutil
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import pytest
import yaml

from tsepm_ros.settings.parameter_files import parameter_file_fits
from tsepm_ros.settings.settings import NODES, make_groups
from tsepm_ros.tools.commands.init_command import (
    init_completed,
    init_file_text,
    init_parameters,
    init_sections,
)

ROOT = Path(__file__).parents[2]
FILE = ROOT / "launch" / "tsepm.launch.xml"
DRIVER = {"detections": "/my_sonar/detections", "odometry": "/my_navigation/odometry"}

pytestmark = pytest.mark.skipif(not FILE.exists(), reason="only in the source tree")


class Started(NamedTuple):
    parameters: dict[str, object]
    remaps: dict[str, str]
    arguments: str
    process: dict[str, str]


def started(**given: str) -> dict[str, Started]:
    """The nodes that start with some arguments, by executable; if included, NAMESPACE/that."""
    nodes, values = dict[str, Started](), dict[str, str]()
    start(FILE, given, values, nodes)
    assert set(given) <= set(values)
    return nodes


def start(file: Path, given: dict[str, str], values: dict[str, str], nodes: dict[str, Started]):
    """Read a file as `launch` does: a file that is included sees the variables of the other."""

    def resolved(text: str) -> str:
        text = re.sub(r"\$\(var (\w+)\)", lambda found: values[found[1]], text)
        text = text.replace("$(find-pkg-share tsepm_ros)", str(ROOT))
        expression = re.fullmatch(r"\$\(eval '(.*)'\)", text)
        return str(eval(expression[1].replace("\\'", "'"))) if expression else text

    def holds(element: ElementTree.Element) -> bool:
        wanted = resolved(element.get("if", "true")).lower() == "true"
        return wanted and resolved(element.get("unless", "false")).lower() == "false"

    for element in ElementTree.parse(file).getroot():
        name = element.get("name", "")
        if element.tag == "arg":
            values[name] = given.get(name, resolved(element.get("default", "")))
        elif element.tag == "let" and holds(element):
            values[name] = resolved(element.get("value", ""))
        elif element.tag == "node" and holds(element):
            executable = element.get("exec", "")
            namespace = f"{resolved(element.get('namespace', ''))}/" * (file != FILE)
            assert namespace + executable not in nodes, "each starts once"
            nodes[namespace + executable] = Started(
                _parameters(element, resolved, executable),
                {r.get("from", ""): resolved(r.get("to", "")) for r in element.iter("remap")},
                resolved(element.get("args", "")),
                {a: resolved(element.get(a, "")) for a in ("namespace", "name", "respawn")},
            )
        elif element.tag == "executable" and holds(element):
            nodes["says"] = Started({}, {}, resolved(element.get("cmd", "")), {})
        elif element.tag == "include" and holds(element):
            passed = {one.get("name", ""): resolved(one.get("value", "")) for one in element}
            start(Path(resolved(element.get("file", ""))), passed, values, nodes)


def _parameters(element, resolved, executable):
    """Parameters as launch passes them: the files in their order, then those by name."""
    parameters: dict[str, object] = {}
    node = "/".join(
        ["", *filter(None, [resolved(element.get("namespace", "")).strip("/"), executable])]
    )
    for one in element.iter("param"):
        if one.get("from"):
            text = Path(resolved(one.get("from"))).read_text(encoding="utf-8")
            for key, values in yaml.safe_load(text).items():
                parameters |= values["ros__parameters"] if parameter_file_fits(key, node) else {}
    for one in element.iter("param"):
        if one.get("name"):
            value = resolved(one.get("value"))
            parameters[one.get("name")] = value if one.get("type") else yaml.safe_load(value)
    return parameters


@pytest.fixture(autouse=True)
def _with_rviz(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: f"/opt/ros/jazzy/bin/{name}")


@pytest.fixture
def own_file(tmp_path):
    path = tmp_path / "mine.yaml"
    mine = {"own_ship_source": "tf", "fixed_frame": "map", "publish_potential_tracks": True}
    mine["use_sim_time"] = True
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": mine}}))
    return str(path)


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"rviz": "true"},
        {"simulate": "true", "rate_factor": "20.0"},
        {**DRIVER, "own_ship_source": "odometry", "rviz": "true"},
        {"own_ship_source": "tf", "fixed_frame": "map"},
        {"viewer": "true", "respawn": "true"},
    ],
)
def test_every_node_takes_the_parameters_that_it_is_given(given):
    for executable, node in started(**given).items():
        if executable in NODES:
            parameters = {k: v for k, v in node.parameters.items() if k != "use_sim_time"}
            make_groups(NODES[executable], parameters)


def test_the_viewer_starts_on_demand_and_again_as_the_initiator_does():
    assert "track_viewer" not in started()
    viewer = started(viewer="true", respawn="true", namespace="/boat")["track_viewer"].process
    assert (viewer["namespace"], viewer["respawn"]) == ("/boat", "true")


def test_the_driver_s_topics_and_the_own_ship_are_given_to_the_initiator():
    [node] = started(**DRIVER, own_ship_source="odometry", fixed_frame="map").values()
    assert node.remaps == {
        "detections": DRIVER["detections"],
        "own_ship/odometry": DRIVER["odometry"],
    }
    assert (node.parameters["own_ship_source"], node.parameters["fixed_frame"]) == (
        "odometry",
        "map",
    )


@pytest.mark.parametrize("file", ["imaging_sonar", "marine_radar", "ping360", "mine"])
def test_with_a_topic_of_images_the_detector_starts_before_the_initiator(tmp_path, file):
    path = ROOT / "config" / f"{file}.yaml"
    if file == "mine":
        path = tmp_path / "mine.yaml"
        answers = init_completed({"images": 1.0, "max_range": 40.0, "sector": 130.0})
        path.write_text(init_file_text(init_sections(answers, init_parameters(answers)), "mine"))
    nodes = started(params_file=str(path), image="/sonar/image", use_sim_time="true")
    assert set(nodes) == {"sonar_detector", "track_initiator"}
    detector, tracker = nodes["sonar_detector"], nodes["track_initiator"]
    ship = {"own_ship/odometry": "own_ship/odometry"}
    assert detector.remaps == {"image": "/sonar/image", "detections": "detections", **ship}
    assert detector.remaps["detections"] == tracker.remaps["detections"]
    assert detector.parameters["use_sim_time"] is True
    for executable, node in nodes.items():
        make_groups(NODES[executable], _known(node.parameters))
        assert len(node.parameters) > 2
    shared = {name for name in detector.parameters if name.startswith("sensor.m")}
    assert {name: detector.parameters[name] for name in shared} == {
        name: tracker.parameters[name] for name in shared
    }


@pytest.fixture
def two_sonars(tmp_path):
    """A file with a section for the detector of port, which holds in any namespace."""
    path = tmp_path / "my_sonars.yaml"
    port = {"image.rows": "beams", "tracker_sensor": "port"}
    tracker = {"sensors": ["port", "starboard"], "max_speed": 3.0}
    sections = {"/**/port/sonar_detector": port, "/**/track_initiator": tracker}
    path.write_text(
        yaml.safe_dump({key: {"ros__parameters": one} for key, one in sections.items()})
    )
    return str(path)


@pytest.mark.parametrize(
    ("namespace", "above", "odometry"),
    [
        ("", "/", {}),
        ("boat", "/boat/", {"odometry": "nav"}),
        ("/boat", "/boat/", {"odometry": "/nav"}),
    ],
)
def test_each_of_several_sonars_with_images_has_a_detector_in_a_namespace_of_its_name(
    two_sonars, namespace, above, odometry
):
    given = {"params_file": two_sonars, "namespace": namespace, "own_ship_source": "odometry"}
    nodes = started(images="[port, starboard=/left/image]", fixed_frame="map", **given, **odometry)
    front = f"{namespace}/" * bool(namespace)
    port, starboard = (nodes[f"{front}{name}/sonar_detector"] for name in ("port", "starboard"))
    assert set(nodes) == {f"{front}{name}/sonar_detector" for name in ("port", "starboard")} | {
        "track_initiator"
    }
    topic = odometry.get("odometry", "own_ship/odometry")
    topic = topic if topic.startswith("/") else above + topic
    assert port.remaps == {"image": "image", "own_ship/odometry": topic}
    assert starboard.remaps == {"image": "/left/image", "own_ship/odometry": topic}
    for name, node in (("port", port), ("starboard", starboard)):
        make_groups(NODES["sonar_detector"], _known(node.parameters))
        assert node.parameters["tracker"] == "track_initiator", "above"
        assert node.parameters["tracker_sensor"] == name
        assert node.parameters["fixed_frame"] == "map"
        assert node.parameters["own_ship_source"] == "odometry"
    assert port.parameters["image.rows"] == "beams"
    unplaced = started(params_file=two_sonars, images="port")["port/sonar_detector"]
    assert "fixed_frame" not in unplaced.parameters


def test_images_of_several_sonars_need_their_names_in_the_file_and_no_topic_of_one(two_sonars):
    with pytest.raises(
        FileNotFoundError, match=r"^images:=\[port\]: .* has no sensors; tsepm init"
    ):
        started(images="[port]")
    with pytest.raises(FileNotFoundError, match=r"^image:=/a: not with images"):
        started(images="[port]", image="/a", params_file=two_sonars)


def test_the_detector_gets_the_pose_of_a_moving_sonar_as_the_initiator_does():
    given = {"own_ship_source": "odometry", "odometry": "/nav", "fixed_frame": "map"}
    for node in started(image="/sonar/image", **given).values():
        assert node.remaps["own_ship/odometry"] == "/nav"
        assert {name: node.parameters[name] for name in ("own_ship_source", "fixed_frame")} == {
            "own_ship_source": "odometry",
            "fixed_frame": "map",
        }


def test_a_file_without_a_section_of_the_detector_leaves_it_at_its_defaults(own_file):
    for given in ({}, {"params_file": own_file}):
        node = started(image="/sonar/image", **given)["sonar_detector"]
        make_groups(NODES["sonar_detector"], _known(node.parameters))
        assert node.parameters["fixed_frame"] == ""


@pytest.mark.parametrize(
    ("given", "changed"),
    [
        ({}, {}),
        ({"own_ship_source": "odometry"}, {"own_ship_source": "odometry"}),
        ({"fixed_frame": "odom"}, {"fixed_frame": "odom"}),
        ({"use_sim_time": "false"}, {"use_sim_time": False}),
        (
            {"own_ship_source": "none", "use_sim_time": "False"},
            {"own_ship_source": "none", "use_sim_time": False},
        ),
        ({"own_ship_source": "none", "rviz": "true"}, {"own_ship_source": "none"}),
    ],
)
def test_what_is_given_comes_before_the_file_and_leaves_the_others_as_in_it(
    own_file, given, changed
):
    in_the_file = yaml.safe_load(Path(own_file).read_text())["/**"]["ros__parameters"]
    found = started(params_file=own_file, **given)["track_initiator"].parameters
    assert found == {**in_the_file, **changed}


@pytest.mark.parametrize(
    "given",
    [
        {"params_file": "/no/such.yaml"},
        {"params_file": "/tmp"},
        {"params_file": ""},
        {"own_ship_source": "gps"},
        {"use_sim_time": "on"},
    ],
)
def test_a_file_or_a_value_that_does_not_exist_ends_the_launch_by_its_argument(given):
    [(argument, value)] = given.items()
    with pytest.raises(FileNotFoundError, match=f"^{argument}:={value}: "):
        started(**given)


def test_namespace_name_and_respawn_are_arguments():
    given = {"namespace": "boat", "name": "starter", "respawn": "true"}
    assert started(**given)["track_initiator"].process == given
    assert started()["track_initiator"].process == {
        "namespace": "",
        "name": "track_initiator",
        "respawn": "false",
    }
    together = started(namespace="boat", simulate="true", rviz="true")
    assert {node.process["namespace"] for node in together.values()} == {"boat"}


def test_without_rviz2_the_launch_says_so_and_goes_on(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    nodes = started(rviz="true")
    assert set(nodes) == {"track_initiator", "says"}
    assert "rviz2 is not installed" in nodes["says"].arguments
    assert not nodes["track_initiator"].parameters["publish_potential_tracks"]


def test_a_display_of_rviz_is_remapped_into_the_namespace():
    config = (ROOT / "config" / "rviz" / "track_initiator.rviz").read_text(encoding="utf-8")
    shown = set(re.findall(r"Value: (/[a-z_/]+)$", config, re.MULTILINE))
    assert shown <= set(started(rviz="true")["rviz2"].remaps)


@pytest.mark.parametrize("source", [{}, {"own_ship_source": "odometry"}, {"simulate": "true"}])
def test_potential_tracks_are_published_where_rviz_shows_them(source):
    nodes = started(rviz="true", **source)
    assert nodes["track_initiator"].parameters["publish_potential_tracks"] is True
    assert nodes["rviz2"].arguments.endswith("-f odom")
    mapped = started(rviz="true", own_ship_source="tf", fixed_frame="map")
    assert mapped["rviz2"].arguments.endswith("-f map")
    assert not started(**source)["track_initiator"].parameters["publish_potential_tracks"]


@pytest.mark.parametrize("frame", ["", "map"])
def test_simulator_and_initiator_have_the_same_fixed_frame(frame):
    nodes = started(simulate="true", **({"fixed_frame": frame} if frame else {}))
    assert nodes["sonar_simulator"].parameters["fixed_frame"] == (frame or "odom")
    make_groups(NODES["sonar_simulator"], _known(nodes["sonar_simulator"].parameters))
    if frame:
        assert nodes["track_initiator"].parameters["fixed_frame"] == frame


def _known(parameters):
    return {name: value for name, value in parameters.items() if name != "use_sim_time"}


def test_simulator_and_initiator_have_the_same_topics():
    nodes = started(simulate="true", **DRIVER)
    assert nodes["sonar_simulator"].remaps == nodes["track_initiator"].remaps
    assert nodes["track_initiator"].parameters["own_ship_source"] == "odometry"
