"""Base class of the track initiation methods: options, and the step on an observed scan."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.initiation.observation import Observation, Step
from tsepm_ros.kinematics.track import ConfirmedTrack, TrackArrays
from tsepm_ros.sensing.sensor import SensorModel


class Method(ABC):
    """A track initiation method: an observed scan in, newly confirmed tracks out.

    Parameters
    ----------
    sensor : SensorModel
    common : CommonOptions
        Options that all methods share.
    options : Options
        The method's own options.
    """

    Options: ClassVar[type[Any]]
    """Frozen dataclass of the method's own parameters."""

    operating_points: ClassVar[Mapping[str, Mapping[str, Any]]] = {"default": {}}
    """Options by a short label, from few to many false tracks; an evaluation sweeps them."""

    most_tracks_true: ClassVar[bool] = False
    """Whether most confirmed tracks are true, so that their detections are a sample of targets'.

    The clutter map then leaves them out, and the detection probability is estimated from them by
    default. To leave out the detections of false tracks would bias the density low and create more
    false tracks.
    """

    def __init__(self, sensor: SensorModel, common: CommonOptions, options: Any) -> None:
        self.sensor = sensor
        self.common = common.resolved(self.most_tracks_true)
        self.options = options
        self.forget()

    @abstractmethod
    def step(self, observed: Observation) -> Step:
        """Take one observed scan and return the tracks that it newly confirms."""

    @abstractmethod
    def forget(self) -> None:
        """Forget the scans so far and the potential tracks."""

    def potential_tracks(self, observed: Observation) -> TrackArrays:
        """Hypotheses with at least two hits that may yet be confirmed, after the last scan.

        Their `track_id` is their place in the list.
        """
        return TrackArrays.of([])

    def reason(self, track: ConfirmedTrack) -> str:
        """The reason for which a track was confirmed, with the present options."""
        return f"{len(track.hits)} hits in {track.scan_count} pings"

    def configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; returns whether the potential tracks are kept.

        A method that cannot continue them under the new options overrides this and starts over. It
        replaces its arrays and never changes them in place: a copy may share them.
        """
        self.sensor = sensor
        self.common = common.resolved(self.most_tracks_true)
        self.options = options
        return True
