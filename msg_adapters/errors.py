"""The error that every adapter raises for an unusable message."""

from __future__ import annotations


class MessageError(ValueError):
    """A message that cannot be used as a whole.

    Parameters
    ----------
    reason : str
        Reason for counting. Every adapter may raise ``unknown_type``,
        ``package_not_installed``, ``missing_field``, ``stamp_invalid`` and ``frame_axes``; messages
        of arrays ``wrong_length``;
        clouds ``duplicate_field``, ``wrong_datatype``, ``wrong_count``, ``bad_offset``,
        ``bad_row_step`` and ``short_data``;
        clouds of tracks ``bad_id`` too;
        odometry ``not_finite``, ``zero_quaternion`` and ``undefined_heading``.
    sentence : str
        Message for the log; it names the field.

    Attributes
    ----------
    reason : str
    """

    def __init__(self, reason: str, sentence: str) -> None:
        super().__init__(reason, sentence)
        self.reason = reason

    def __str__(self) -> str:
        """Return the sentence."""
        return str(self.args[1])
