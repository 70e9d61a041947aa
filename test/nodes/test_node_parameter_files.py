"""Parameter files, overrides and their tools: in namespaces, under other names, and back again."""

from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import parameter_dict_from_yaml_file
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from support.ros_world import remapped

from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.settings.settings import NODES, full_table
from tsepm_ros.tools.commands.arguments import as_yaml
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator


def arguments_of(path: Path, remaps: Sequence[str] = ()) -> list[str]:
    return [*remapped(*remaps), "--params-file", str(path)]


@pytest.mark.parametrize(
    "remaps",
    [[], ["__ns:=/boat"], ["__node:=starter"], ["__ns:=/fleet/boat", "__node:=starter"]],
    ids=["as_it_is", "namespace", "name", "both"],
)
def test_a_generated_file_fits_any_name_and_namespace(world, tmp_path, remaps):
    path = tmp_path / "mine.yaml"
    generated = as_yaml("track_initiator", NODES["track_initiator"])
    path.write_text(generated.replace("max_speed: 10.0", "max_speed: 7.5"))
    node = world.make(TrackInitiator, cli_args=arguments_of(path, remaps))
    assert node.get_parameter("max_speed").value == 7.5
    for row in full_table(NODES["track_initiator"]):
        if row.name not in ("max_speed", "method"):
            assert node.get_parameter(row.name).value == row.default
    assert not any("is not used" in line for line in world.logged())


def test_a_file_that_does_not_fit_is_named(world, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("track_initiator:\n  ros__parameters: {max_speed: 7.5}\n")
    node = world.make(
        TrackInitiator, {"plots": False}, cli_args=arguments_of(path, ["__ns:=/boat"])
    )
    assert node.get_parameter("max_speed").value == 10.0
    assert node.get_parameter("plots").value == "off", "off without quotes is the text"
    world.until_logged("mine.yaml is not used", "/boat/track_initiator", "/**", level=30)


def test_an_empty_list_ends_an_executable_with_a_sentence(start, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("/**:\n  ros__parameters:\n    max_speed: []\n")
    process = start("track_initiator", arguments=["--params-file", str(path)])
    assert process.exit_code() == 2
    assert "Traceback" not in process.said
    assert "max_speed has no value" in process.said.splitlines()[-1]


def test_dumped_parameters_load_again(world, tmp_path):
    """As `ros2 param dump` writes them, and as `ros2 param load` sends them."""
    node = world.make(TrackInitiator, {"sensor.clutter_density": 1e-6, "method": "score"})
    rows = [row for row in full_table(NODES["track_initiator"]) if not row.read_only]
    values = {row.name: node.get_parameter(row.name).value for row in rows}
    path = tmp_path / "dumped.yaml"
    path.write_text(yaml.dump({"/track_initiator": {"ros__parameters": values}}))
    sent = parameter_dict_from_yaml_file(str(path))
    request = SetParameters.Request(parameters=list(sent.values()))
    results = world.call(SetParameters, "/track_initiator/set_parameters", request).results
    assert [result.reason for result in results if not result.successful] == []
    assert {row.name: node.get_parameter(row.name).value for row in rows} == values
    again = world.make(TrackInitiator, cli_args=arguments_of(path), enable_rosout=False)
    assert again.get_parameter("sensor.clutter_density").value == 1e-6


def test_the_quality_of_service_of_publishers_may_be_overridden(world):
    prefix = "qos_overrides./tracks.publisher"
    node = world.make(
        TrackInitiator,
        {
            f"{prefix}.reliability": "best_effort",
            f"{prefix}.depth": 7,
            "qos_overrides./tracks/current.publisher.durability": "volatile",
        },
    )
    [tracks] = world.observer.get_publishers_info_by_topic("/tracks")
    assert tracks.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    [current] = world.observer.get_publishers_info_by_topic("/tracks/current")
    assert current.qos_profile.durability == DurabilityPolicy.VOLATILE
    assert node.get_parameter(f"{prefix}.depth").value == 7


OTHER = [
    ("/detections.subscription.reliability", "best_effort", "only publishers take overrides"),
    ("/nowhere.publisher.depth", 5, "the node publishes"),
    ("/diagnostics.publisher.depth", 0, "at least 1"),
    ("/diagnostics.publisher.depth", 2**31, "below 2"),
    ("/diagnostics.publisher.reliability", "sometimes", "reliable or best_effort"),
    ("/diagnostics.publisher.deadline", 5, "the policy must be"),
]


def test_other_overrides_are_refused_with_a_sentence(world):
    for name, value, part in OTHER:
        for kind, topic in ((TrackInitiator, "/diagnostics"), (SonarSimulator, "/detections")):
            with pytest.raises(ParameterError, match="qos_overrides") as error:
                world.make(kind, {f"qos_overrides.{name.replace('/diagnostics', topic)}": value})
            assert part in str(error.value)
