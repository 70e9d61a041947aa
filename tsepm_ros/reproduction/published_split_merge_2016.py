"""Numbers as Split-merge 2016 prints them, and what its text says of Table I."""

from __future__ import annotations

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
