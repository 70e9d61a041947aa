"""Labels of points: apart from each other where there is room, and written where there is none."""

import itertools

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import matplotlib.pyplot as plt

from tsepm_ros.tools.pictures.plan_marks import (
    LABEL_ANGLES,
    LABEL_DISTANCES,
    PointLabel,
    label_points,
)


def notes_of(size: float, points: np.ndarray):
    """Labels of points in axes of a size, inches, whose limits are 0 and 1."""
    figure = plt.figure(figsize=(size, size))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    labels = [PointLabel(str(n), x, y, "black") for n, (x, y) in enumerate(points.tolist())]
    label_points(axes, labels)
    plt.close(figure)
    return list(axes.texts)


def test_labels_of_close_points_overlap_neither_each_other_nor_the_points():
    notes = notes_of(5.0, 0.5 + 0.01 * np.random.default_rng(1).standard_normal((12, 2)))
    assert [note.get_text() for note in notes] == [str(n) for n in range(12)]
    boxes = [super(type(note), note).get_window_extent() for note in notes]
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))


def test_a_label_without_a_free_position_is_at_the_last():
    (note,) = notes_of(0.1, np.array([[0.5, 0.5]]))
    assert note.get_position()[1] == pytest.approx(LABEL_DISTANCES[-1] * np.sin(LABEL_ANGLES[-1]))
