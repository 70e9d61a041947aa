"""What tests of several tools share."""

import pytest

from tsepm_ros.tools.design import prediction


@pytest.fixture
def little_clutter(monkeypatch):
    """A bound on the work: rates of false tracks are told less exactly."""
    monkeypatch.setattr(prediction, "MAX_CLUTTER_DETECTIONS", 1_000.0)
