"""The improved sequential method on scenes by hand."""

from __future__ import annotations

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, scan_at

from tsepm_ros import make_initiator
from tsepm_ros.tracker.measurement import convert


def initiator(**options):
    return make_initiator("sequential", sensor=FIXED_RANGE_ERROR, **options)


def confirmed_at(seen: str, **options) -> list[int]:
    """Scans, from 1 on, that confirm a target seen where `seen` has a 1."""
    made = initiator(**options)
    found = []
    for k, one in enumerate(seen):
        where = [(3000.0, 5.0 * 12.0 * k)] if one == "1" else []
        found += [k + 1] * len(made.process(scan_at(12.0 * k, where)))
    return found


@pytest.mark.parametrize(
    ("seen", "confirmed"),
    [("1111011", [7]), ("1110010101", [10]), ("1010010101", []), ("10100101011", [])],
    ids=["figure 3", "figure 4", "figure 5", "a sixth hit too late"],
)
def test_six_of_ten_as_in_the_figures(seen, confirmed):
    assert confirmed_at(seen) == confirmed


@pytest.mark.parametrize(
    ("ranges", "hits"),
    [
        ([3000, 3000, 3000, 3000, 3200, 3150, 3150], [1, 2, 3, 4, 6, 7]),
        ([3000, 3000, 3000, 3200, 3310, 3250, 3450, 3400, 3600, 3550], [1, 2, 3, 6, 8, 10]),
    ],
    ids=["figure 3", "figure 4"],
)
def test_points_outside_the_gate_leave_the_track_its_later_ones(ranges, hits):
    found = {}
    for matching in ("oldest", "nearest"):
        made = initiator(matching=matching)
        tracks = []
        for k, x in enumerate(ranges):
            tracks += made.process(scan_at(12.0 * k, [(float(x), 0.0)]))
        found[matching] = [[scan + 1 for scan, _ in track.hits] for track in tracks]
    assert found["oldest"] == [hits]
    assert hits not in found["nearest"], "the points outside must contend for the later ones"


@pytest.mark.parametrize("gap", [1, 2, 3, 5])
@pytest.mark.parametrize("inside", [True, False])
def test_the_gate_is_that_of_equation_7(gap, inside):
    # Hits along the line of sight: distances are differences of the unbiased ranges.
    made = initiator(min_hits=2)
    made.process(scan_at(0.0, [(3000.0, 0.0)]))
    for k in range(1, gap):
        made.process(scan_at(12.0 * k, []))
    reach = 10.0 * gap * 12.0 + 2.0 * 30.0
    unbiased = np.exp(0.5 * FIXED_RANGE_ERROR.azimuth_std**2)
    step = (reach + (-0.01 if inside else 0.01)) / unbiased
    assert len(made.process(scan_at(12.0 * gap, [(3000.0 + step, 0.0)]))) == inside


def test_the_margin_may_be_of_the_position_s_error():
    scan = scan_at(0.0, [(3000.0, 0.0)])
    sigma = convert(scan, FIXED_RANGE_ERROR, 0)["major_sigma"][0]
    assert sigma > 50.0
    for error, found in (("range", 0), ("major_axis", 1)):
        made = initiator(min_hits=2, gate_error=error)
        made.process(scan)
        assert len(made.process(scan_at(12.0, [(3000.0, 120.0 + 2.0 * sigma - 1.0)]))) == found
