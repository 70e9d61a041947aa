"""Plots in plain loops: complete linkage as it is defined, one merge after the other."""

import math


def plain_distance(
    one: tuple[float, float], two: tuple[float, float], along: float, across: float, beam: float
) -> float:
    """Distance of two detections (range, azimuth) over how far apart they may be."""
    middle = 0.5 * (one[0] + two[0])
    turn = math.remainder(one[1] - two[1], 2.0 * math.pi)
    return max(abs(one[0] - two[0]) / along, middle * abs(turn) / (across + middle * beam))


def plain_groups(
    detections: list[tuple[float, float]], along: float, across: float, beam: float
) -> set[frozenset[int]]:
    """Groups by complete linkage: the two nearest are joined as long as they are within 1."""
    groups = [frozenset([row]) for row in range(len(detections))]

    def distance(one: frozenset[int], two: frozenset[int]) -> float:
        return max(
            plain_distance(detections[a], detections[b], along, across, beam)
            for a in one
            for b in two
        )

    while len(groups) > 1:
        pairs = [(a, b) for a in range(len(groups)) for b in range(a)]
        a, b = min(pairs, key=lambda pair: distance(groups[pair[0]], groups[pair[1]]))
        if distance(groups[a], groups[b]) > 1.0:
            break
        joined = groups[a] | groups[b]
        groups = [group for row, group in enumerate(groups) if row not in (a, b)] + [joined]
    return set(groups)
