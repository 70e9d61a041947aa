"""Tables as texts, for the terminal and in Markdown, and what a run gave in them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from tsepm_ros.analysis.truth import Judged, Outcome


def text_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lay out a table in columns, the first left and the others right aligned."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    texts = [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([texts[0], "-" * len(texts[0]), *texts[1:]])


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lay out a table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def target_table(judged: Sequence[Judged], truths: Sequence[np.ndarray], scan_of: dict) -> str:
    """Table of each target's first true start against the truth.

    Parameters
    ----------
    judged : sequence of Judged
        The run's tracks.
    truths : sequence of (4,) ndarray
        The targets' states at the stamps of their starts, nan for one without.
    scan_of : dict of float to int
        Number of the scan, from 1, by its stamp.
    """
    starts = {one.target: one for one in judged if one.outcome is Outcome.TRUE}
    rows = []
    for target, truth in enumerate(truths):
        one = starts.get(target)
        if one is None:
            rows.append([str(target), *["not started"], *[""] * 6])
            continue
        state, sigma = one.track.state, np.sqrt(np.diag(one.track.covariance))
        rows.append(
            [
                str(target),
                str(scan_of[one.track.stamp]),
                f"{truth[0]:.0f}, {truth[2]:.0f}",
                f"{state[0]:.0f}, {state[2]:.0f}",
                f"{one.position_error:.0f} ({np.hypot(sigma[0], sigma[2]):.0f})",
                f"{truth[1]:.1f}, {truth[3]:.1f}",
                f"{state[1]:.1f}, {state[3]:.1f}",
                f"{one.velocity_error:.1f} ({np.hypot(sigma[1], sigma[3]):.1f})",
            ]
        )
    header = [
        "target",
        "scan",
        "truth x, y [m]",
        "start x, y",
        "error (sigma)",
        "truth v [m/s]",
        "start v",
        "error (sigma)",
    ]
    return text_table(header, rows)


def counts_line(judged: Sequence[Judged], scans: int, area: float) -> str:
    """One line that counts the tracks by what they are.

    Parameters
    ----------
    judged : sequence of Judged
    scans : int
    area : float
        Area covered, m^2.
    """
    number = {outcome: sum(one.outcome is outcome for one in judged) for outcome in Outcome}
    wrong = number[Outcome.FALSE] + number[Outcome.MISPLACED]
    return (
        f"{len(judged)} confirmed tracks: {number[Outcome.TRUE]} true, "
        f"{number[Outcome.REDUNDANT]} redundant, {number[Outcome.MISPLACED]} misplaced, "
        f"{number[Outcome.FALSE]} false; false and misplaced {wrong / (scans * area / 1e6):.3f} "
        "per scan and km^2"
    )
