"""Charts from nav_msgs/OccupancyGrid."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from msg_adapters import MessageError, read_land


def grid(width=3, height=2, data=(0, 100, -1, 49, 50, 7), x=10.0, y=20.0, q=(0, 0, 0, 1), **more):
    """A grid with the fields of the message."""
    origin = SimpleNamespace(
        position=SimpleNamespace(x=x, y=y, z=0.0),
        orientation=SimpleNamespace(**dict(zip("xyzw", q, strict=True))),
    )
    info = {"resolution": more.get("resolution", 2.0), "width": width, "height": height}
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=more.get("frame", "odom")),
        info=SimpleNamespace(origin=origin, **info),
        data=np.array(data, np.int8),
    )


def test_rows_go_along_x_and_unknown_is_no_land():
    mask = read_land(grid())
    centres = np.array([[11 + 2 * column, 21 + 2 * row] for row in range(2) for column in range(3)])
    assert mask.covers(centres).tolist() == [False, True, False, False, True, False]
    assert mask.cells == 2


QUARTER_TURN = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))


def test_the_origin_may_be_turned():
    mask = read_land(grid(q=QUARTER_TURN))
    assert mask.origin == pytest.approx((10.0, 20.0, math.pi / 2))
    covered = mask.covers(np.array([[9.0, 23.0], [7.0, 23.0], [9.0, 21.0]]))
    assert covered.tolist() == [True, True, False]


@pytest.mark.parametrize(("turn", "centre"), [({}, (13.0, 25.0)), ({"q": QUARTER_TURN}, (15, 17))])
def test_land_of_a_ned_frame_has_rows_along_north(turn, centre):
    mask = read_land(grid(data=(0, 0, 0, 0, 0, 100), x=20.0, y=10.0, frame="map_ned", **turn))
    assert mask.cells == 1 and mask.covers(np.array([centre])).all()


@pytest.mark.parametrize(("width", "height"), [(0, 0), (0, 5), (5, 0)])
def test_a_grid_without_cells_is_no_chart(width, height):
    assert read_land(grid(width, height, (), resolution=0.0)) is None


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    "bad",
    [
        {"width": 4},
        {"width": 2**32 - 1, "height": 2**32 - 1},
        {"data": ()},
        {"resolution": 0.0},
        {"resolution": NAN},
        {"resolution": INF},
        {"resolution": -2.0},
        {"resolution": 1e30},
        {"x": NAN},
        {"y": INF},
        {"x": 1e300},
        {"q": (0.0, 0.0, 0.0, 0.0)},
        {"q": (NAN, 0.0, 0.0, 1.0)},
        {"q": (0.3, 0.0, 0.0, 1.0)},
        {"q": (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))},
        {"q": (1.0, 0.0, 0.0, 0.0)},
    ],
    ids=str,
)
def test_a_grid_that_is_not_usable_is_refused(bad):
    with pytest.raises(MessageError) as refusal:
        read_land(grid(**bad))
    assert refusal.value.reason == "land_invalid"
    assert str(refusal.value)
