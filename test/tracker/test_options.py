"""Options: what is refused, and what `auto` stands for."""

import pytest

from tsepm_ros.tracker.options import CommonOptions


def test_min_speed_must_be_below_max_speed():
    with pytest.raises(ValueError, match="min_speed must be below max_speed"):
        CommonOptions(min_speed=5.0, max_speed=5.0)
    with pytest.raises(ValueError, match="min_speed"):
        CommonOptions(min_speed=-1.0)
