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
"""The evaluation of `tsepm evaluate` with the peers in the same tables and pictures.

Peers start tracks but hold none here, and norfair gives no covariance. Measures that need them are
left out for peers. `jipda` is joint integrated probabilistic data association as published, with
tracks that start on single detections (`contenders/jipda.py`).

    python benchmarks/evaluate_peers.py box --runs 100 --horizon 8
"""

from __future__ import annotations

import argparse
import importlib
import shlex
import sys
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import fixed_threads  # noqa: F401  # before numpy
import numpy as np
from contenders import Contender, RawScan, Sea

from tsepm_ros import ConfirmedTrack, Scan
from tsepm_ros.tools.commands.evaluate_command import add_evaluate_arguments, run_evaluate
from tsepm_ros.tools.evaluation.result_files import result_code_key
from tsepm_ros.tools.evaluation.simulated_run import SimulatedOperatingPoint
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.simulation.scenario import ScenarioOwnShipMotion

RULES = ((8, 12), (6, 8), (5, 8), (4, 5), (3, 4))
"""(min_hits, window) of a peer's sweep, from few to many false tracks."""
CONFIRM = (0.999, 0.99, 0.97, 0.9, 0.7, 0.5)
"""Existence probability from which a track of JIPDA is confirmed, as a sweep."""
PEERS = {
    "stonesoup": ("stonesoup", "stone_soup", "TunedStoneSoupContender"),
    "stonesoup-xy": ("stonesoup", "stone_soup", "ConvertedStoneSoupContender"),
    "norfair": ("norfair", "norfair_tracker", "NorfairContender"),
    "jipda": ("numpy", "jipda", "JipdaContender"),
}
"""Package, module and class of each, without Stone Soup's k-d tree, which gates by range alone."""


class PeerStarter:
    """A contender as the track starter of an evaluation; it holds no tracks."""

    def __init__(self, contender: Contender) -> None:
        self._contender = contender
        self._started = 0

    def process(self, scan: Scan) -> list[ConfirmedTrack]:
        """See `SimulatedTrackStarter.process`; unknown states and covariances are nan."""
        self._contender.process(RawScan(scan.stamp, scan.range, scan.azimuth))
        hits = self._contender.hits()
        states, covariances = self._contender.states(), self._contender.covariances()
        if states is None:
            states = np.full((len(hits), 4), np.nan)
        if covariances is None:
            covariances = np.full((len(hits), 4, 4), np.nan)
        tracks = [
            ConfirmedTrack(self._started + row, scan.stamp, *estimate, hits=own, evaluation=np.nan)
            for row, (*estimate, own) in enumerate(zip(states, covariances, hits, strict=True))
        ]
        self._started += len(tracks)
        return tracks


def sea_of(scenario: Scenario) -> Sea:
    """Parameters of a scenario for contenders; a ValueError if they cannot process it.

    Contenders support no moving sensor, no echo times and no constant range error.
    """
    sensor = scenario.sensor
    if scenario.own_ship != ScenarioOwnShipMotion() or scenario.sound_speed or sensor.range_std:
        raise ValueError(
            f"the peers cannot process {scenario.name}: they need own_ship at rest at the origin, "
            "sound_speed 0 and sensor.range_std 0 (--scene sound_speed:=0.0)"
        )
    return Sea(
        clutter_density=sensor.clutter_density,
        period=scenario.period,
        max_range=sensor.max_range,
        range_std_fraction=sensor.range_std_fraction,
        azimuth_std=sensor.azimuth_std,
        detection_probability=sensor.detection_probability,
    )


def make_peer(scenario: Scenario, peer: str, options: Mapping[str, Any]) -> PeerStarter:
    """Make a peer for a scenario."""
    _, module, kind = PEERS[peer]
    contender = getattr(importlib.import_module(f"contenders.{module}"), kind)
    return PeerStarter(contender(sea_of(scenario), **options))


def peer_points(peer: str) -> Iterator[SimulatedOperatingPoint]:
    """The sweep of a peer; an ImportError if its package is not installed."""
    package, module, _ = PEERS[peer]
    importlib.import_module(package)
    folder = Path(__file__).resolve().parent
    files = [folder / "evaluate_peers.py", folder / "contenders" / f"{module}.py"]
    release = f"{package} {version(package)} {result_code_key(*files)}"
    rules: dict[str, dict[str, float]] = {
        f"{min_hits}/{window}": {"min_hits": min_hits, "window": window}
        for min_hits, window in RULES
    }
    if peer == "jipda":
        rules = {f"{confirm:g}": {"confirm": confirm} for confirm in CONFIRM}
    for label, options in rules.items():
        yield SimulatedOperatingPoint(peer, label, options, make_peer, release)


def installed(peers: list[str]) -> list[SimulatedOperatingPoint]:
    """The sweeps of the peers with an installed package; the others are reported."""
    points = []
    for peer in peers:
        try:
            points += peer_points(peer)
        except ImportError as error:
            print(f"{peer} left out: {error}", file=sys.stderr)
    return points


def main() -> int:
    """Evaluate, print and write; returns 2 if an argument is not allowed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_evaluate_arguments(parser)
    parser.add_argument("--peer", action="append", choices=PEERS, help="default: every peer")
    options = parser.parse_args()
    options.line = shlex.join(["python", "benchmarks/evaluate_peers.py", *sys.argv[1:]])
    try:
        run_evaluate(options, installed(options.peer or list(PEERS)))
    except ValueError as error:
        print(f"refused: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
