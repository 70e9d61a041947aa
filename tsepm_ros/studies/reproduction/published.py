"""Numbers as the sources print them.

Numbers as Sequential 2014 prints them, Section 5.

Numbers as Environment 2018 prints them.

Numbers as Split-merge 2016 prints them, and what its text says of Table I.

Numbers as TSEPM 2018 prints them, and what the text claims of figures without numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

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
SEQUENTIAL_MAX_SPEED = 10.0
"""m/s."""
SQUARE_SIDE = 400.0
"""m."""
PLATFORM_SPEED = 4.0
"""m/s."""
MAX_RANGE = 10_000.0
"""m."""
CLUTTER = 30
SEQUENTIAL_RANGE_ERROR_FRACTION = 0.015
ANGLE_ERROR_DEG = 1.0

FOUR_OR_MORE = 1.0
"""Probability that four or more targets are started, Fig. 8."""
ALL_SIX = 0.52
FORMED = {72.0: 1.1, 84.0: 3.4, 96.0: 5.3, 108.0: 5.8, 120.0: 6.0}
"""Tracks formed by a time (s), Fig. 9."""
SEQUENTIAL_TABLE_1 = {
    "least_squares": (82.3, 0.46, 8.6),
    "linear_fitting": (114.5, 4.2, 13.2),
    "kalman_filter": (210.6, 8.5, 12.7),
}
"""Errors of position (m), speed (m/s) and angle (degrees)."""

ENCOUNTER = ((18_000.0, 187.0, 6.0, 330.0), (17_000.0, 189.0, 4.0, 190.0))
"""Targets A and B of Fig. 4: distance (m), azimuth (degrees), speed (m/s), heading (degrees)."""
ENVIRONMENT_TABLE_1 = ((16.038, 7.500), (22.449, 1.090))
"""Feature distances of plots 1 and 2 to the tracks A and B, to which they are said to belong."""

TABLE_I_RULE = (5, 8)
TABLE_I = {  # (scan, measurement) of each track
    1: ((1, 4), (2, 7), (3, 6), (4, 2), (5, 1)),
    2: ((1, 2), (2, 9), (3, 6), (4, 2), (5, 1)),
    3: ((1, 4), (2, 9), (3, 6), (4, 2), (5, 1)),
    4: ((1, 4), (2, 7), (3, 6), (4, 2), (5, 6)),
    5: ((1, 2), (2, 9), (3, 6), (4, 2), (5, 6)),
    6: ((1, 4), (2, 9), (3, 6), (4, 2), (5, 6)),
    7: ((1, 2), (2, 8), (3, 5), (5, 2), (7, 1)),
    8: ((1, 1), (3, 3), (5, 5), (6, 3), (8, 5)),
    9: ((1, 3), (3, 3), (5, 5), (6, 3), (8, 5)),
    10: ((2, 1), (3, 5), (5, 2), (7, 1), (8, 6)),
    11: ((1, 1), (3, 4), (5, 5), (6, 3), (8, 5)),
    12: ((2, 4), (3, 5), (5, 2), (7, 1), (8, 6)),
    13: ((1, 5), (2, 3), (4, 4), (5, 9), (8, 10)),
}
TRUE_TRACK = 3
TABLE_II = (1, 2, 3, 4, 5, 6)
"""Tracks near the target; the others are Table III's."""
SAID_TO_MERGE = ((2, 3), (1, 4), (5, 6), (8, 9), (8, 11), (10, 12))
SAID_NOT_TO_MERGE = ((5, 7),)
SAID_TO_SPLIT = ((2, 3), (8, 11), (1, 4))
"""At the initial, the medium-term and the terminal stage."""
AFTER_SPLITTING = 13
AFTER_MERGING = 8
AREA_SIDE = 3000.0
"""Side of the area of interest, [4000 4000 7000 7000], m."""


@dataclass(frozen=True)
class Table1Row:
    """A row of TSEPM 2018, Table 1: P_F(1), P_F(2), and P_D at p_d = 1.0, 0.9 and 0.8."""

    rule: tuple[int, int]
    false_before: float
    false_after: float
    detection: tuple[float, float, float]

    @property
    def name(self) -> str:
        """M/N."""
        return "{}/{}".format(*self.rule)


TABLE_1 = tuple(
    Table1Row((m, n), before, after, (one, two, three))
    for m, n, before, after, one, two, three in (
        (3, 4, 0.1822, 0.1004, 0.9720, 0.8149, 0.6470),
        (3, 5, 0.3953, 0.1253, 0.9963, 0.8788, 0.7445),
        (4, 5, 0.0545, 0.0276, 0.9477, 0.7509, 0.5494),
        (4, 6, 0.1554, 0.0618, 0.9871, 0.8348, 0.6506),
        (5, 6, 0.0151, 0.0048, 0.9185, 0.6819, 0.4558),
        (4, 7, 0.2621, 0.1007, 0.9944, 0.8676, 0.7161),
        (5, 7, 0.0536, 0.0174, 0.9842, 0.8217, 0.6243),
        (6, 7, 0.0040, 0.0015, 0.8857, 0.6119, 0.3715),
        (5, 8, 0.1319, 0.0418, 0.9973, 0.8749, 0.7187),
        (6, 8, 0.0170, 0.0059, 0.9743, 0.7819, 0.5535),
        (7, 8, 0.0010, 0.0003, 0.8503, 0.5440, 0.2987),
        (5, 9, 0.3446, 0.0997, 0.9996, 0.8925, 0.7650),
        (6, 9, 0.0497, 0.0194, 0.9950, 0.8572, 0.6725),
        (7, 9, 0.0025, 0.0083, 0.9619, 0.7367, 0.4822),
        (8, 9, 0.0002, 0.0000, 0.8131, 0.4797, 0.2375),
    )
)
TABLE_1_DETECTION_PROBABILITIES = (1.0, 0.9, 0.8)
TABLE_1_DENSITY = 1e-6
"""1/m^2."""
TABLE_1_RUNS = 500
GATE_PROBABILITY = 0.9
MAX_SPEED = 10.0
"""m/s."""
PERIOD = 12.0
"""s."""
GATE_FACTOR = 2.146
"""alpha at 0.9, as printed below Eq. 5."""
RANGE_ERROR_FRACTION = 0.015
COORDINATE = 5000.0
"""Each coordinate of the target's initial position, m."""
RECOMMENDED = {"5/8", "6/9"}
"""Rules that the text finds for p_d = 0.9, P_D above 0.85 and P_F below 0.05."""

FIGURE_7_DENSITY = 5e-6
"""1/m^2; Figs. 5 and 6 state no range of densities, Fig. 8 no density."""
FIGURE_7_MARKS = (75.0, 120.0)
"""Measurement errors between which P_D is said to fall."""
