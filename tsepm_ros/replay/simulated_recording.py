"""A simulated scenario as a recording."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.replay.recording import RecordedMotion, RecordedScan, Recording
from tsepm_ros.simulation.simulator import Simulator

OWN_SHIP_PERIOD = 1.0
"""Time between own-ship poses, s, as in the node `sonar_simulator`."""


def simulated_recording(simulator: Simulator) -> tuple[Recording, list[NDArray[np.int64]]]:
    """Simulate a scenario and record the scans, the own ship's poses and the truth.

    Parameters
    ----------
    simulator : Simulator
        It is iterated once.

    Returns
    -------
    recording : Recording
        The own ship's poses reach beyond the last echo; the truth is at the scans' stamps.
    origins : list of (n,) ndarray of int
        Target of each scan's detections, as in `SimulatedScan`.
    """
    scans: list[RecordedScan] = []
    origins: list[NDArray[np.int64]] = []
    targets: dict[int, list[RecordedMotion]] = {n: [] for n in range(len(simulator.targets))}
    last = simulator.start
    for simulated in simulator:
        scan = simulated.scan
        fields = {"range": scan.range, "azimuth": scan.azimuth}
        if scan.time_offset is not None:
            fields["time_offset"] = scan.time_offset
        scans.append(RecordedScan(scan.stamp, fields))
        for target, state in enumerate(simulated.truth):
            targets[target].append(RecordedMotion(scan.stamp, state))
        origins.append(simulated.origin)
        last = simulated.complete
    return Recording(scans, _own_ship(simulator, last), targets), origins


def _own_ship(simulator: Simulator, last: float) -> list[RecordedMotion]:
    motions = []
    for index in range(math.ceil((last - simulator.start) / OWN_SHIP_PERIOD) + 1):
        time = index * OWN_SHIP_PERIOD
        x, y, yaw = simulator.scenario.own_ship.pose(time).tolist()
        state = np.array([x, 0.0, y, 0.0])
        motions.append(RecordedMotion(simulator.start + time, state, yaw))
    return motions
