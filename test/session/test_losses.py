"""Half of the last scans, or of their detections, lost: said once, with cause and remedy."""

from collections import Counter

import numpy as np
import pytest
from support.sessions import ping, settings

from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.consistency_checks import LAST, Losses, explained
from tsepm_ros.session.session import Session


def heard(made, **more):
    said: dict[str, str] = {}
    return Session(made, said.setdefault, **more), said


@pytest.mark.parametrize("period", [0.1, 12.0])
@pytest.mark.parametrize(("lost", "is_said"), [(0.3, False), (0.55, True), (1.0, True)])
def test_half_of_the_scans_lost_are_said_at_any_rate_of_pings(period, lost, is_said):
    """Also late in a long run: the last scans count."""
    session, said = heard(settings())
    rng = np.random.default_rng(1)
    for index in range(300):
        twice = index > 200 and rng.random() < lost / (1.0 - lost + 1e-9)
        for _ in range(2 if twice and lost < 1.0 else 1):
            stamp = period * (201 if index > 200 and lost == 1.0 else index + 1)
            session.add_scan(ping(stamp), 0.0)
            list(session.process())
    assert ("lost scan_same_stamp" in said) is is_said
    if is_said:
        sentence = said["lost scan_same_stamp"]
        assert f"of the last {LAST} scans were dropped" in sentence
        assert "Remedy: Look for two drivers" in sentence


def test_a_few_poses_dropped_are_no_cause_of_many_scans_lost():
    dropped = {"own_ship_stale": 100, "own_ship_late": 1}
    assert "Compare the clocks" in explained("own_ship_stale", dropped, {})
    assert "two publishers" in explained("own_ship_stale", {**dropped, "own_ship_late": 900}, {})


@pytest.mark.parametrize(("share", "is_said"), [(0.4, False), (0.6, True), (1.0, True)])
def test_half_of_the_detections_lost_are_said(share, is_said):
    losses, said, dropped = Losses(), [], Counter()
    for _ in range(30):
        said += losses.drop("range_above_max", "", round(10 * share), dropped)
        said += losses.processed(10 - round(10 * share), dropped)
    assert len(said) == is_said
    if is_said:
        assert f"{100 * share:.0f} % of the detections" in said[0].sentence
        assert "the driver must set `range_max` in m" in said[0].sentence


@pytest.mark.parametrize("reason", ["flagged_bad", "on_land"])
def test_what_is_expected_to_be_lost_is_not_said(reason):
    losses = Losses()
    for _ in range(30):
        assert losses.drop(reason, "", 100, Counter()) == []
        assert losses.processed(1, Counter()) == []


def test_scans_without_detections_lose_nothing():
    session, said = heard(settings())
    for index in range(30):
        session.add_scan(SensorScan(Scan(float(index), [], []), "sonar"), 0.0)
        list(session.process())
    assert said == {}
