"""Contenders as methods of an evaluation; their packages are not needed for this."""

import sys

import evaluate_peers as peers
import numpy as np
import pytest
from contenders import Contender

from tsepm_ros import Scan
from tsepm_ros.tools.simulation import load_scenario

BOX = load_scenario("box")


class FirstDetection(Contender):
    """Starts a track at the first detection of every scan."""

    def process(self, scan):
        self.seen = getattr(self, "seen", -1) + 1
        self.state = [scan.range[0], 1.0, scan.azimuth[0], 2.0]
        return 1

    def hits(self):
        return [((self.seen, 0),)]

    def states(self):
        return np.array([self.state])

    def counts(self):
        return {"potential": 0}


class WithCovariance(FirstDetection):
    def covariances(self):
        return np.eye(4)[None]


def started(kind, scans=2):
    starter = peers.PeerStarter(kind(peers.sea_of(BOX), 3, 4))
    scans = [Scan(stamp=12.0 * k, range=[100.0 + k], azimuth=[0.5]) for k in range(scans)]
    return [track for scan in scans for track in starter.process(scan)]


def test_a_contender_s_tracks_are_those_of_an_evaluation():
    one, two = started(WithCovariance)
    assert (one.stamp, two.stamp) == (0.0, 12.0)
    assert (one.hits, two.hits) == (((0, 0),), ((1, 0),))
    assert one.track_id != two.track_id
    np.testing.assert_array_equal(two.state, [101.0, 1.0, 0.5, 2.0])
    np.testing.assert_array_equal(two.covariance, np.eye(4))


def test_what_a_contender_does_not_tell_is_nan():
    one, _ = started(FirstDetection)
    assert np.isnan(one.covariance).all()
    assert one.covariance.shape == (4, 4)


def test_a_contender_knows_the_scenario_s_sensor():
    changed = load_scenario("box", {"sensor.clutter_density": 2e-6, "sensor.azimuth_std": 0.03})
    sea = peers.sea_of(changed)
    assert (sea.clutter_density, sea.azimuth_std) == (2e-6, 0.03)
    assert (sea.period, sea.max_range, sea.range_std_fraction) == (12.0, 12000.0, 0.015)


@pytest.mark.parametrize(
    "change", [{"own_ship.speed": 1.0}, {"sound_speed": 1500.0}, {"sensor.range_std": 5.0}]
)
def test_a_scenario_that_contenders_cannot_take_is_refused(change):
    with pytest.raises(ValueError, match="the peers cannot process box"):
        peers.sea_of(load_scenario("box", change))


def test_a_peer_that_is_not_installed_is_told_by_its_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "norfair", None)
    with pytest.raises(ImportError, match="norfair"):
        list(peers.peer_points("norfair"))


@pytest.mark.parametrize("peer", peers.PEERS)
def test_a_peer_that_is_installed_takes_the_rules_of_its_sweep(peer):
    pytest.importorskip(peers.PEERS[peer][0])
    scan = Scan(stamp=0.0, range=[5000.0, 7000.0], azimuth=[0.5, 0.6])
    points = list(peers.peer_points(peer))
    rules = ["8/12", "6/8", "5/8", "4/5", "3/4"]
    levels = ["0.999", "0.99", "0.97", "0.9", "0.7", "0.5"]
    assert [point.label for point in points] == (levels if peer == "jipda" else rules)
    for point in points:
        assert len(point.make(BOX).process(scan)) == 0
