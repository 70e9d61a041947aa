"""The file in which a node keeps what was learned over a restart."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from tsepm_ros.session.drop_reasons import shortened
from tsepm_ros.session.session import Session
from tsepm_ros.tracker.clutter import learned
from tsepm_ros.whole_files import write_text

MAX_SIZE = 2**24
"""Size of the largest file that is read, bytes: of most sensors it is a hundredth of this."""
SAVING_PERIOD = 60.0
"""Time between writings of the file, s."""


class LearnedFile:
    """Reads what was learned at the start, and writes it while the node runs and at its end.

    Ages count on the system's clock: a simulated clock starts again with each run.

    Parameters
    ----------
    session : Session
    path : str
        Empty: nothing is read or written; nor if there can be no regular file of this path.
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
        self._inform, self._warn = inform, warn
        self._failed = False
        self._path: Path | None = None
        if path:
            self._read(path, max_age)

    def _read(self, name: str, max_age: float) -> None:
        try:
            path = Path(name).expanduser()
            if path.exists() and not (path.is_file() and path.stat().st_size <= MAX_SIZE):
                raise OSError(f"it is no regular file of at most {MAX_SIZE} bytes")
            if any(len(part.encode()) > 200 for part in path.parts):  # temporary names are longer
                raise OSError("a name in its path has more than 200 bytes")
            self._path = path
            found, age = learned.read(
                path.read_text(encoding="utf-8"),
                self._session.settings.sensor,
                self._session.settings.session.sensor_frame,
                time.time(),
                max_age,
            )
        except FileNotFoundError:
            return
        except (OSError, ValueError, RuntimeError) as error:  # the last: no such user
            self._warn(
                f"{shortened(f'learned_file {name}')} is not used: "
                f"{getattr(error, 'strerror', None) or error}"  # without the path again
            )
            return
        self._session.tracker.learned = found
        self._inform(
            f"what was learned {age / 60.0:.0f} min ago is used from {path}: clutter density "
            f"{self._session.tracker.clutter_density:.2g} per m^2, detection probability "
            f"{self._session.tracker.estimated_detection_probability:.2f}"
        )

    def forget(self) -> None:
        """Remove the file; a failure is logged."""
        if self._path is None:
            return
        try:
            self._path.unlink(missing_ok=True)
        except (OSError, ValueError) as error:
            self._warn(f"learned_file {self._path} cannot be removed: {error}")

    def write(self) -> None:
        """Write what was learned, if a scan was processed; a failure is logged once."""
        initiator = self._session.tracker
        if self._path is None or initiator.stamp is None:
            return
        frame_id = self._session.settings.session.sensor_frame
        try:
            text = learned.written(initiator.learned, initiator.sensor, frame_id, time.time())
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_text(self._path, text)
            self._failed = False
        except (OSError, ValueError) as error:
            if not self._failed:
                self._warn(shortened(f"learned_file {self._path} cannot be written: {error}"))
            self._failed = True
