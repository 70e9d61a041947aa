"""Simulated scans with known truth."""

from tsepm_ros.tools.simulation.scenario import Scenario, load_scenario, shipped_scenarios
from tsepm_ros.tools.simulation.simulator import CLUTTER, SimulatedScan, Simulator

__all__ = [
    "CLUTTER",
    "Scenario",
    "SimulatedScan",
    "Simulator",
    "load_scenario",
    "shipped_scenarios",
]
