"""Arriving charts."""

from __future__ import annotations

from tsepm_ros.environment.land import LandMask
from tsepm_ros.session.refusal import Notice, Refusal, Remark


class LandInput:
    """The newest chart, from its arrival until the fixed frame is known.

    Attributes
    ----------
    mask : LandMask or None
        The chart in use.
    """

    def __init__(self) -> None:
        self.mask: LandMask | None = None
        self._frame = ""
        self._new: tuple[LandMask | None, str] | None = None

    def add(self, mask: LandMask | None, frame_id: str) -> None:
        """Take a chart, or None for an empty chart, in a frame."""
        self._new = mask, frame_id

    def reset(self) -> None:
        """Wait for the fixed frame again: a chart is published once."""
        if self._new is None and self.mask is not None:
            self._new = self.mask, self._frame
        self.mask = None

    def settle(self, fixed: str) -> Remark | None:
        """Use or refuse the newest chart, once the fixed frame is known; it replaces the last."""
        if self._new is None or not fixed:
            return None
        (mask, frame), self._new = self._new, None
        if mask is None:
            had, self.mask = self.mask is not None, None
            return Notice("land", "land is empty: no detections are left out") if had else None
        if frame != fixed:
            return Refusal(
                "land_frame", f"land is in frame {frame!r}, the fixed frame is {fixed!r}"
            )
        self.mask, self._frame = mask, frame
        return Notice(
            "land",
            f"land: detections on {mask.cells} cells of {mask.resolution:g} m are left out",
        )
