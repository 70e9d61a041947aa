"""The failure of a command whose arguments are allowed."""


class CommandFailed(Exception):  # noqa: N818
    """A command failed for the reason in the message, which has the remedy."""
