"""The file in which a node keeps what was learned over a restart."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from tsepm_ros.environment import learned_memory
from tsepm_ros.session.session import Session
from tsepm_ros.whole_files import write_text

SAVING_PERIOD = 60.0
"""Time between writings of the file, s."""


class LearnedFile:
    """Reads what was learned at the start, and writes it while the node runs and at its end.

    Ages count on the system's clock: a simulated clock starts again with each run.

    Parameters
    ----------
    session : Session
    path : str
        Empty: nothing is read or written.
    max_age : float
        s.
    inform, warn : callable
        Loggers.
    """

    def __init__(
        self,
        session: Session,
        path: str,
        max_age: float,
        inform: Callable[[str], object],
        warn: Callable[[str], object],
    ) -> None:
        self._session = session
        self._path = Path(path).expanduser() if path else None
        self._inform, self._warn = inform, warn
        self._failed = False
        if self._path is not None and self._path.exists():
            self._read(self._path, max_age)

    @property
    def used(self) -> bool:
        """Whether there is a file."""
        return self._path is not None

    def _read(self, path: Path, max_age: float) -> None:
        sensor = self._session.settings.sensor
        frame_id = self._session.settings.session.sensor_frame
        try:
            text = path.read_text(encoding="utf-8")
            found = learned_memory.read(text, sensor, frame_id, time.time(), max_age)
        except (OSError, ValueError) as error:
            self._warn(f"learned_file {path} is not used: {error}")
            return
        self._session.initiator.remember(found.learned)
        self._inform(
            f"what was learned {found.age / 60.0:.0f} min ago is used from {path}: clutter density "
            f"{self._session.initiator.clutter_density:.2g} per m^2, detection probability "
            f"{self._session.initiator.estimated_detection_probability:.2f}"
        )

    def forget(self) -> None:
        """Remove the file; a failure is logged."""
        if self._path is None:
            return
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            self._warn(f"learned_file {self._path} cannot be removed: {error}")

    def write(self) -> None:
        """Write what was learned, if a scan was processed; a failure is logged once."""
        initiator = self._session.initiator
        if self._path is None or initiator.stamp is None:
            return
        frame_id = self._session.settings.session.sensor_frame
        text = learned_memory.written(initiator.learned, initiator.sensor, frame_id, time.time())
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_text(self._path, text)
            self._failed = False
        except OSError as error:
            if not self._failed:
                self._warn(f"learned_file {self._path} cannot be written: {error}")
            self._failed = True
