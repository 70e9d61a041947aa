"""Fixtures of tracks and headers."""

from support.track_fixtures import header, make_track, over_the_wire  # noqa: F401
