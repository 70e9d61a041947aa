"""The node that simulates a sonar: detections, own ship and truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tsepm_ros.nodes.node_parameters import NodeParameters, ParameterisedNode
from tsepm_ros.nodes.playback import Playback
from tsepm_ros.nodes.played_scenario import PlayedScenario
from tsepm_ros.nodes.running import run
from tsepm_ros.settings.node_help import help_text
from tsepm_ros.settings.node_options import PlaybackOptions, SimulatorNodeOptions
from tsepm_ros.settings.tables import SONAR_SIMULATOR


class SonarSimulator(ParameterisedNode):
    """Publishes the scans of a scenario as a sonar driver would."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("sonar_simulator", **node_options)
        options = NodeParameters(self, SONAR_SIMULATOR).options
        played = PlayedScenario(self, options[SimulatorNodeOptions])
        self.finished = Playback(self, played, options[PlaybackOptions]).finished
        self.refuse_unused_overrides()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(SonarSimulator, args, help_text("sonar_simulator", __doc__))


if __name__ == "__main__":
    raise SystemExit(main())
