"""Fixed echoes as markers."""

from __future__ import annotations

import numpy as np
from visualization_msgs.msg import Marker

from msg_adapters import fixed_echo_markers
from msg_adapters.track_markers import MAX_LABELS


def test_each_echo_has_a_cube_and_a_label_with_its_minutes(header, make_track, over_the_wire):
    echoes = [
        make_track(state=np.array([10.0, 0.0, -20.0, 0.0]), age=90.0),
        make_track(track_id=2**32 - 1, state=np.array([5.0, 0.0, 7.0, 0.0]), age=600.0),
    ]
    _, cubes, *labels = over_the_wire(fixed_echo_markers(header, echoes)).markers
    assert (cubes.type, cubes.action, cubes.header) == (Marker.CUBE_LIST, Marker.ADD, header)
    assert [(point.x, point.y) for point in cubes.points] == [(10.0, -20.0), (5.0, 7.0)]
    assert min(cubes.scale.x, cubes.scale.y, cubes.scale.z, cubes.color.a) > 0.0
    assert [label.text for label in labels] == [f"{2**32 - 1}: 10.0 min", "7: 1.5 min"]
    assert [label.pose.position.x for label in labels] == [5.0, 10.0]
    names = [(marker.ns, marker.id) for marker in (cubes, *labels)]
    assert len(set(names)) == len(names)


def test_of_very_many_the_oldest_have_labels(header, make_track):
    echoes = [make_track(track_id=number, age=float(number)) for number in range(MAX_LABELS + 5)]
    _, cubes, *labels = fixed_echo_markers(header, echoes).markers
    assert len(cubes.points) == MAX_LABELS + 5
    assert len(labels) == MAX_LABELS
    assert labels[0].text.startswith(f"{MAX_LABELS + 4}:")
