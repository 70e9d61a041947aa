"""The node that plays recorded scans on the topics of a sonar driver."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tsepm_ros.nodes.node_parameters import (
    NodeParameters,
    ParameterError,
    ParameterisedNode,
    refusing,
)
from tsepm_ros.nodes.playback import Playback
from tsepm_ros.nodes.played_bag import PlayedBag
from tsepm_ros.nodes.played_recording import PlayedRecording
from tsepm_ros.nodes.running import run
from tsepm_ros.replay.recording_source import source_of
from tsepm_ros.settings.node_help import help_text
from tsepm_ros.settings.node_options import PlaybackOptions, PlayerNodeOptions
from tsepm_ros.settings.tables import SCAN_PLAYER


class ScanPlayer(ParameterisedNode):
    """Publishes the scans, the own ship and the truth of a CSV recording or a bag."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("scan_player", **node_options)
        options = NodeParameters(self, SCAN_PLAYER).options
        player: PlayerNodeOptions = options[PlayerNodeOptions]
        if not player.recording:
            raise ParameterError("recording must be a folder of CSV files or a bag; got ''")
        with refusing("recording"):
            played_class = PlayedBag if source_of(player.recording)[1] else PlayedRecording
        self._played = played_class(self, player)
        self.finished = Playback(self, self._played, options[PlaybackOptions]).finished
        self.refuse_unused_overrides()

    def destroy_node(self) -> None:
        """Destroy the node and close the recording."""
        super().destroy_node()
        self._played.close()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(ScanPlayer, args, help_text("scan_player", __doc__))


if __name__ == "__main__":
    raise SystemExit(main())
