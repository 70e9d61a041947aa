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
"""Targets of several detections in whole scenes: one start each."""

import math
from dataclasses import replace

import clusters as benchmark
import numpy as np
import pytest
from clusters_scenes import Pool, Swimmers
from support.builders import observation_of

from tsepm_ros import Scan, SensorModel, available_methods, make_initiator
from tsepm_ros.methods.registry import make_method
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.settings import Settings

MANY = [
    pytest.param(spread, common, id=f"{spread:g}m-{'common' if common else 'independent'}")
    for spread in (1.0, 3.0)
    for common in (True, False)
]


def initiator_of(scene: Swimmers, method: str = "score", **options):
    return make_initiator(method, sensor=scene.sensor, max_speed=5.0, **options)


def check(runs: list[benchmark.Run]) -> None:
    """At most one start of the target once clusters are made, and one track in the end."""
    for run in runs:
        assert run.on < math.inf
        assert sum(start.target == 0 for start in run.starts) <= 1
        assert benchmark.first(run) < math.inf
        false = sum(start.target < 0 for start in run.starts)
        assert run.held <= 1 + false


@pytest.mark.parametrize(("density", "sensor"), [("given", "given"), ("estimated", "unknown")])
@pytest.mark.parametrize(("spread", "common"), MANY)
def test_a_swimmer_of_several_echoes_is_one(spread, common, density, sensor):
    scene = Swimmers(spread=spread, common=common, pings=25)
    check([benchmark.run(scene, 0, density, sensor)])


def test_known_from_the_start_they_are_started_as_one_echo_is():
    scene = Swimmers(pings=14)
    single = replace(scene, echoes=(1, 1))
    for seed in range(4):
        run = benchmark.run(scene, seed, target_extent=6.0)
        alone = benchmark.run(single, seed)
        assert [start.target for start in run.starts] == [0]
        assert benchmark.first(run) <= benchmark.first(alone) + 1


def test_two_swimmers_farther_apart_than_their_extent_stay_two():
    for common in (True, False):
        scene = Swimmers(spread=1.0, common=common, apart=(40.0, 0.0), pings=25)
        run = benchmark.run(scene, 1)
        assert run.held == 2
        assert {start.target for start in run.starts} == {0, 1}


@pytest.mark.long
@pytest.mark.parametrize("extent", [20.0, 40.0])
def test_a_vessel_longer_than_a_cluster_is_one(extent):
    scene = Swimmers(echoes=(3, 8), extent=extent, speed=3.0, pings=35)
    runs = [benchmark.run(scene, seed, "estimated") for seed in range(1, 9)]
    # At 0.98 a run, six or fewer of eight come once in 97 times.
    assert sum(run.held == 1 for run in runs) >= 7
    # A first start on its end may be lost.
    assert sum(len(run.starts) for run in runs) <= 16


def test_a_vessel_keeps_its_id_when_its_first_hits_leave_the_window():
    scene = Swimmers(echoes=(3, 8), extent=20.0, speed=3.0, pings=40)
    assert len(benchmark.run(scene, 5, "estimated").starts) == 1


@pytest.mark.parametrize(
    "seed", [2, *(pytest.param(seed, marks=pytest.mark.long) for seed in (5, 6))]
)
def test_swimmers_of_one_echo_that_pass_each_other_are_no_clusters(seed):
    run = benchmark.watched(Pool(echoes=1, false=4.0, pings=140), seed)
    assert not run.clusters
    assert run.held > 0.97


@pytest.mark.parametrize("false", [16.0, pytest.param(50.0, marks=pytest.mark.long)])
def test_swimmers_are_held_in_the_clutter_of_a_fast_sonar(false):
    # 5e-4 and 1.6e-3 false detections a m^2: a hull's gate holds some anywhere.
    for seed in range(2):
        run = benchmark.watched(Pool(false=false, pings=120), seed)
        assert run.clusters
        assert run.held > 0.97
        assert run.elsewhere < 0.5


def test_swimmers_of_two_echoes_beside_each_other_are_held():
    # 6 m apart: what lies beside them a second later is no part of them.
    run = benchmark.watched(Pool(echoes=2, false=4.0, pings=120), 6)
    assert run.clusters
    assert run.held > 0.97


@pytest.mark.parametrize("method", available_methods())
def test_with_an_extent_clusters_are_on_from_the_first_scan(method):
    echoes = Scan(0.0, [100.0, 101.5], [0.5, 0.5])
    for extent, number in ((3.0, 1), (0.0, 2)):
        sensor = SensorModel(max_range=300.0)
        initiator = make_initiator(method, sensor=sensor, target_extent=extent)
        initiator.process(echoes)
        assert initiator.statistics.plots == number


@pytest.mark.parametrize("extent", [0.0, 3.0])
@pytest.mark.parametrize("method", available_methods())
def test_score_alone_takes_an_error_across_as_large_as_along(method, extent):
    sensor = SensorModel(range_std=8.0, range_std_fraction=0.0, azimuth_std=0.001, max_range=900.0)
    for own in (None, np.full(3, 0.001)):
        initiator = make_initiator(method, sensor=sensor, target_extent=extent)
        scan = Scan(0.0, [200.0, 400.0, 401.0], np.zeros(3), azimuth_std=own)
        found = observation_of(initiator, scan).detections
        along, across = np.sqrt(found["covariance"][:, [0, 1], [0, 1]]).T
        assert len(found) == (2 if extent else 3)
        # Of a cluster the extent is in their own errors, along and across.
        if method == "score" and own is None and not extent:
            np.testing.assert_allclose(across, along)
        else:
            assert (across < 0.5 * along).all()


def test_a_hit_is_the_clusters_strongest_detection():
    sensor = SensorModel(range_std=0.5, range_std_fraction=0.0, azimuth_std=0.01, max_range=300.0)
    initiator = make_initiator("score", sensor=sensor, target_extent=3.0)
    tracks = []
    for stamp in range(8):
        place = 100.0 + stamp
        scan = Scan(
            float(stamp),
            [50.0, place, place + 1.0, 400.0, place + 0.5],
            [2.0 * math.cos(stamp), 0.0, 0.0, 0.0, 0.0],
            features={"intensity": [1.0, 2.0, 7.0, 9.0, 3.0]},
        )
        tracks += initiator.process(scan)
    assert [row for _, row in tracks[0].hits] == [2] * len(tracks[0].hits)
    assert initiator.statistics.detections == 4
    assert initiator.statistics.plots == 2
    assert initiator.statistics.outside_coverage == 1


def test_a_reset_and_other_options_start_over():
    scene = Swimmers(pings=12)
    initiator = initiator_of(scene)
    for ping in scene.draw(3):
        initiator.process(ping.scan)
    assert initiator.sensor.extended_targets.active
    same = make_method("score", sensor=scene.sensor, max_speed=6.0)
    other = make_method("score", sensor=replace(scene.sensor, max_range=250.0), max_speed=6.0)
    initiator, kept = initiator.with_settings(same)
    assert kept and initiator.sensor.extended_targets.active
    initiator, _ = initiator.with_settings(other)
    assert not initiator.sensor.extended_targets.active
    initiator, _ = initiator.with_settings(same)
    assert not initiator.sensor.extended_targets.active
    for ping in scene.draw(4):
        initiator.process(replace(ping.scan, stamp=ping.scan.stamp + 100.0))
    assert initiator.sensor.extended_targets.active
    initiator.reset()
    assert not initiator.sensor.extended_targets.active


def test_the_session_says_so_once():
    scene = Swimmers(pings=15)
    said = []
    session = Session(Settings(sensor=scene.sensor), lambda *what: said.append(what))
    for ping in scene.draw(3):
        session.add_scan(UnregisteredScan(scan=ping.scan, frame_id="sonar"), ping.scan.stamp)
        list(session.process())
    sentences = [sentence for reason, sentence in said if reason == "plots"]
    assert len(sentences) == 1
    assert "several detections per ping" in sentences[0]


def test_neighbouring_rays_are_one_cluster_at_once():
    sensor = SensorModel(range_std=0.5, range_std_fraction=0.0, azimuth_std=0.01, max_range=300.0)
    azimuth = np.array([-0.01, 0.0, 0.01, 1.0, 2.0, 2.5])
    group = np.array([0, 0, 0, 1, 1, -1])
    initiator = make_initiator("score", sensor=sensor)
    for stamp in range(8):
        place = 100.0 + stamp
        range_ = [place + 0.1, place, place + 0.1, 50.0, 50.0, 50.0]
        initiator.process(Scan(float(stamp), range_, azimuth, group=group))
        assert initiator.statistics.detections == 6
        # The second run is 50 m long, a shore: cut in pieces.
        assert initiator.statistics.plots == 4
    assert 1 in {track.hits[-1][1] for track in initiator.current} <= {1, 3, 4, 5}
