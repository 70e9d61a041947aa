"""Parameter files of sonars that publish images: a section for each node."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from tsepm_ros.settings.settings import NODES, make_groups

CONFIG = Path(__file__).parents[2] / "config"


@pytest.mark.parametrize("name", ["ping360", "marine_radar", "imaging_sonar"])
def test_both_nodes_accept_their_section_and_agree_on_the_coverage(name):
    sections = yaml.safe_load((CONFIG / f"{name}.yaml").read_text("utf-8"))
    given = {}
    for section, content in sections.items():
        node, values = section.rpartition("/")[2], content["ros__parameters"]
        flat = {
            f"{key}.{inner}" if isinstance(value, dict) else key: one
            for key, value in values.items()
            for inner, one in (value.items() if isinstance(value, dict) else [("", value)])
        }
        make_groups(NODES[node], flat)
        given[node] = {key: one for key, one in flat.items() if key.startswith("sensor.")}
    assert set(given) == {"sonar_detector", "track_initiator"}
    for key, one in given["sonar_detector"].items():
        assert given["track_initiator"][key] == one
