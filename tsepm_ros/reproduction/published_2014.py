"""Numbers as Sequential 2014 prints them, Section 5."""

from __future__ import annotations

SCANS = 10
"""Of the rule 6 of 10, and of two minutes with the interval of the text."""
PERIODS = (12.0, 8.0)
"""Of the text and Fig. 9, and of the list of parameters, s."""
DURATION = 120.0
"""s."""
RUNS = 400
TARGETS = 6
DISTANCE = 6000.0
"""Of the hexagon's corners, m."""
TARGET_SPEED = 5.0
"""m/s."""
MAX_SPEED = 10.0
"""m/s."""
SQUARE_SIDE = 400.0
"""m."""
PLATFORM_SPEED = 4.0
"""m/s."""
MAX_RANGE = 10_000.0
"""m."""
CLUTTER = 30
RANGE_ERROR_FRACTION = 0.015
ANGLE_ERROR_DEG = 1.0

FOUR_OR_MORE = 1.0
"""Probability that four or more targets are started, Fig. 8."""
ALL_SIX = 0.52
FORMED = {72.0: 1.1, 84.0: 3.4, 96.0: 5.3, 108.0: 5.8, 120.0: 6.0}
"""Tracks formed by a time (s), Fig. 9."""
TABLE_1 = {
    "least_squares": (82.3, 0.46, 8.6),
    "linear_fitting": (114.5, 4.2, 13.2),
    "kalman_filter": (210.6, 8.5, 12.7),
}
"""Errors of position (m), speed (m/s) and angle (degrees)."""
