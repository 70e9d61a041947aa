"""Operating points: a method at one setting, as a factory of track starters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from tsepm_ros.analysis.code_version import code_key
from tsepm_ros.initiation.initiator import Initiator
from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.methods.registry import METHODS, make_initiator, option_names
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.simulation import Scenario


class TrackStarter(Protocol):
    """Interface of what is evaluated: an `Initiator`, or an object with the same `process`.

    The evaluation reads `stamp`, `state`, `covariance` (nan if unknown) and `hits` of its tracks.
    With the optional attribute `current`, tracks with a `state` (n, 4) at the last scan's
    stamp, the held tracks are evaluated too.
    """

    def process(self, scan: Scan) -> Sequence[ConfirmedTrack]:
        """Process the next scan and return the tracks newly confirmed by it."""


def make_method(scenario: Scenario, method: str, options: Mapping[str, Any]) -> Initiator:
    """Make one of the package's own methods for a scenario's sensor."""
    return make_initiator(method, sensor=scenario.sensor, **options)


@dataclass(frozen=True)
class OperatingPoint:
    """A method at one setting.

    Attributes
    ----------
    method, label : str
        Names of the method and of the setting in its sweep.
    options : mapping
        All options given to the method.
    factory : callable
        Makes a `TrackStarter` from a scenario, `method` and `options`; importable by its name, so
        that other processes can make it too.
    version : str
        Version of the code that the results depend on; results of another version are not reused.
    """

    method: str
    label: str = "default"
    options: Mapping[str, Any] = field(default_factory=dict)
    factory: Callable[[Scenario, str, Mapping[str, Any]], TrackStarter] = make_method
    version: str = ""

    def make(self, scenario: Scenario) -> TrackStarter:
        """Make a new track starter for a run."""
        return self.factory(scenario, self.method, self.options)


def operating_points(
    methods: Iterable[str], given: Mapping[str, Any] | None = None
) -> list[OperatingPoint]:
    """Operating points of the methods' sweeps, from few to many false tracks.

    Parameters
    ----------
    methods : iterable of str
    given : mapping, optional
        Options for the methods that have them. A method whose sweep varies a given option is
        evaluated at the given value only.

    Raises
    ------
    ValueError
        If no method has a given option; the message names the option.
    """
    given = given or {}
    methods = list(methods)
    for name in given:
        if not any(name in option_names(method) for method in methods):
            raise ValueError(f"{name} is not an option of {' or '.join(methods)}")
    return [point for method in methods for point in _sweep(method, given)]


def _sweep(method: str, given: Mapping[str, Any]) -> list[OperatingPoint]:
    own = {name: value for name, value in given.items() if name in option_names(method)}
    sweep = METHODS[method].operating_points
    if any(name in options for options in sweep.values() for name in own):
        sweep = {"as given": {}}
    return [
        OperatingPoint(method, label, {**own, **options}, version=code_key())
        for label, options in sweep.items()
    ]
