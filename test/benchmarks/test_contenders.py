# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Contenders: as methods of an evaluation, JIPDA by brute force, Bernoulli's rule, a network."""

import itertools
import sys

import evaluate_peers as peers
import numpy as np
import pytest
import weak_targets
from contenders import Contender, RawScan, Sea, bernoulli, learned_starter
from contenders.bernoulli import RATIOS_DB, BernoulliFilter
from contenders.jipda import JipdaContender, association_marginals, enumerated, propagated
from detector import SENSOR, STEP

from tsepm_ros import Scan, make_initiator
from tsepm_ros.tools.evaluation.simulated_run import SimulatedScene
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


def test_a_contender_s_tracks_are_those_of_an_evaluation_and_what_it_does_not_tell_is_nan():
    one, two = started(WithCovariance)
    assert (one.stamp, two.stamp) == (0.0, 12.0)
    assert (one.hits, two.hits) == (((0, 0),), ((1, 0),))
    assert one.track_id != two.track_id
    np.testing.assert_array_equal(two.state, [101.0, 1.0, 0.5, 2.0])
    np.testing.assert_array_equal(two.covariance, np.eye(4))
    np.testing.assert_array_equal(started(FirstDetection)[0].covariance, np.full((4, 4), np.nan))


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


SEA = Sea(clutter_density=1e-7)


def brute_force(weight):
    """Marginals over every assignment of detections (or none, -1) to tracks."""
    n, d = weight.shape
    total, sums = 0.0, np.zeros((n, d))
    for event in itertools.product(range(-1, d), repeat=n):
        taken = [column for column in event if column >= 0]
        if len(taken) != len(set(taken)):
            continue
        factor = np.prod([weight[row, column] for row, column in enumerate(event) if column >= 0])
        total += factor
        for row, column in enumerate(event):
            if column >= 0:
                sums[row, column] += factor
    return sums / total


@pytest.mark.parametrize("seed", range(8))
def test_marginals_are_those_of_every_joint_event(seed):
    rng = np.random.default_rng(seed)
    weight = rng.exponential(2.0, (4, 5)) * (rng.random((4, 5)) < 0.5)
    expected = brute_force(weight)
    np.testing.assert_allclose(association_marginals(weight), expected, atol=1e-12)
    np.testing.assert_allclose(propagated(weight), expected, atol=0.03)


def test_two_tracks_do_not_share_a_detection():
    marginal = enumerated(np.full((2, 1), 1e6))
    assert marginal.sum() == pytest.approx(1.0, abs=1e-5)
    assert marginal[0, 0] == pytest.approx(0.5, abs=1e-5)


def confirmed(scans, **options):
    """The contender, and the scans at which tracks were confirmed."""
    contender = JipdaContender(SEA, **options)
    return contender, [index for index, scan in enumerate(scans) if contender.process(scan)]


def passing(scans, first=0):
    """A target at 4 m/s that is detected at every scan, without errors."""
    for index in range(first, first + scans):
        x, y = 3000.0 + 4.0 * 12.0 * index, 1000.0
        yield RawScan(12.0 * index, np.array([np.hypot(x, y)]), np.array([np.arctan2(y, x)]))


def test_a_target_is_confirmed_once_with_its_state_and_hits_and_a_higher_existence_confirms_later():
    contender = JipdaContender(SEA)
    found = []
    for index, scan in enumerate(passing(16)):
        if contender.process(scan):
            found.append(index)
            (hits,), (state,) = contender.hits(), contender.states()
            assert hits == tuple((k, 0) for k in range(index + 1))
            np.testing.assert_allclose(state[0::2], [3000.0 + 48.0 * index, 1000.0], atol=60.0)
    assert len(found) == 1
    assert found[0] <= 6
    scans = list(passing(16))
    early, late = (confirmed(scans, confirm=level)[1] for level in (0.5, 0.999))
    assert early[0] < late[0]


def test_a_target_that_left_ends_and_is_confirmed_again_when_it_returns():
    gone = [RawScan(12.0 * index, np.empty(0), np.empty(0)) for index in range(10, 30)]
    contender, found = confirmed([*passing(10), *gone, *passing(10, first=30)])
    assert len(found) == 2
    assert contender.counts()["potential"] >= 0


def test_the_existence_of_a_bernoulli_filter_is_bayes_rule():
    """First image: the target is anywhere, so that each detection weighs by its power alone."""
    one = BernoulliFilter(SENSOR, STEP, threshold=5.0, max_speed=2.0)
    powers = np.array([5.5, 9.0])
    one.process(1.0, np.array([10.0, 20.0]), np.array([0.1, -0.3]), powers)
    signal = 1.0 + 10.0 ** (np.array(RATIOS_DB) / 10.0)
    mean_false = 128 * 400 * np.exp(-5.0)
    likelihood = 1.0 - np.exp(-5.0 / signal).mean()
    for power in powers:
        with_target = (np.exp(-power / signal) / signal).mean()
        likelihood += with_target / (np.exp(-power) / np.exp(-5.0)) / mean_false
    prior = np.log(bernoulli.BIRTH / (1.0 - bernoulli.BIRTH))
    assert one.log_odds - prior == pytest.approx(np.log(likelihood), rel=1e-6)
    assert one.uniform + one.weight.sum() == pytest.approx(1.0)


def test_a_bernoulli_filter_follows_a_target_and_forgets_one_that_is_gone():
    one, rng = BernoulliFilter(SENSOR, STEP, threshold=7.0, max_speed=2.0), np.random.default_rng(1)
    odds = []
    for k in range(1, 41):
        false = rng.poisson(one.number)
        range_, azimuth = rng.uniform(1.0, 41.0, false), rng.uniform(-1.0, 1.0, false)
        power = 7.0 + rng.exponential(size=false)
        if k <= 15:
            x, y = 10.0 + 0.8 * k, 2.0 + 0.1 * k
            range_, azimuth = (
                np.append(range_, np.hypot(x, y)),
                np.append(azimuth, np.arctan2(y, x)),
            )
            power = np.append(power, 15.0)
        one.process(float(k), range_, azimuth, power)
        odds.append(one.log_odds)
        if k == 15:
            np.testing.assert_allclose(one.estimate(), [22.0, 0.8, 3.5, 0.1], atol=0.1)
    assert odds[14] > 10.0 and odds[-1] < 0.0


def test_starts_are_counted_again_after_the_odds_have_fallen():
    assert weak_targets.upward([0.0, 5.0, 4.0, 5.0, 1.0, 6.0], 4.5) == 2
    assert weak_targets.upward([5.0, 6.0], 7.0) == 0


def test_the_ratio_at_a_share_is_that_of_the_law():
    ratios = np.array(RATIOS_DB)
    share = 1.0 / (1.0 + np.exp(-1.2 * (ratios - 9.0)))
    found = np.random.default_rng(1).random((4000, len(ratios))) < share
    expected = 9.0 + np.log(9.0) / 1.2
    assert weak_targets.ratio_at(found.astype(float)) == pytest.approx(expected, abs=0.15)


def test_a_network_learns_and_a_higher_logit_keeps_fewer_tracks():
    rng = np.random.default_rng(1)
    figures = rng.normal(size=(4000, 11))
    own = (figures[:, 0] * figures[:, 1] > 0.0).astype(float)  # no linear rule tells them apart
    network = learned_starter.trained(figures, own)
    assert ((learned_starter.logit(network, figures) > 0.0) == own).mean() > 0.9
    counts = []
    for logit in (-2.0, 1.0):
        initiator = make_initiator(
            "contenders.learned_starter:LearnedStarter", sensor=BOX.sensor, logit=logit
        )
        scene = SimulatedScene.drawn(BOX, [1, 0])
        counts.append(sum(len(initiator.process(scan)) for scan in scene.scans))
    assert counts[0] > counts[1]
    assert learned_starter.LearnedStarter.files == (learned_starter.WEIGHTS,)
