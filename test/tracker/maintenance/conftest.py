"""What the tests of held tracks share."""

import math

import pytest

from tsepm_ros.tracker import motion
from tsepm_ros.tracker.maintenance import data_association


@pytest.fixture
def straight(monkeypatch):
    """Targets neither turn nor fade nor vanish: what is left has closed forms."""
    monkeypatch.setattr(motion, "SCANS_TO_TURN", math.inf)
    monkeypatch.setattr(data_association, "SCANS_TO_FADE", math.inf)
    monkeypatch.setattr(data_association, "SCANS_TO_VANISH", math.inf)
