"""Numbers as Environment 2018 prints them."""

from __future__ import annotations

ENCOUNTER = ((18_000.0, 187.0, 6.0, 330.0), (17_000.0, 189.0, 4.0, 190.0))
"""Targets A and B of Fig. 4: distance (m), azimuth (degrees), speed (m/s), heading (degrees)."""
TABLE_1 = ((16.038, 7.500), (22.449, 1.090))
"""Feature distances of plots 1 and 2 to the tracks A and B."""
DECISION = ("A", "B")
"""Whose plots 1 and 2 are."""
