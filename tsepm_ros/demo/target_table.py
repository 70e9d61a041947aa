"""The table of the demonstration: each target with its true start and its errors."""

from __future__ import annotations

import numpy as np

from tsepm_ros.analysis.text_tables import text_table
from tsepm_ros.pictures.run_scene import RunScene, target_name

HEADER = ["target", "track", "found after [s]", "pings", "hits"]
HEADER += ["position error [m]", "1 sigma [m]", "velocity error [m/s]", "1 sigma [m/s]"]


def target_table(scene: RunScene) -> str:
    """Table of each target's true start, with its errors and their standard deviations."""
    header, *rows = target_rows(scene)
    return text_table(header, rows)


def target_rows(scene: RunScene) -> list[list[str]]:
    """The header and a row per target of a judged run."""
    return [HEADER, *(_row(target, scene) for target in range(len(scene.truth)))]


def _row(target: int, scene: RunScene) -> list[str]:
    start = scene.true_starts.get(target)
    if start is None:
        return [target_name(target), "none", *[""] * (len(HEADER) - 2)]
    track = start.track
    sigma = np.sqrt(np.diag(track.covariance))
    return [
        target_name(target),
        str(track.track_id),
        f"{track.stamp - scene.scans[0].stamp:.0f}",
        str(scene.start_scans[track.track_id]),
        str(len(track.hits)),
        f"{start.position_error:.0f}",
        f"{np.hypot(sigma[0], sigma[2]):.0f}",
        f"{start.velocity_error:.1f}",
        f"{np.hypot(sigma[1], sigma[3]):.1f}",
    ]
