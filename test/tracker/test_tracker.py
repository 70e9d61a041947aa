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
"""The tracker's verb stage by stage on made scans; its ids, refusals and options."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, reconfigured, scan_at

from tsepm_ros import ConfirmedTrack, Scan, SensorModel, make_initiator
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays, TrackStatus

HERE = (3000.0, 0.0)


def initiator(**options):
    return make_initiator(
        "tsepm", sensor=FIXED_RANGE_ERROR, **{"min_hits": 3, "window": 4, **options}
    )


def test_what_is_no_scan_is_refused():
    with pytest.raises(ValueError, match=r"scan must be a tsepm_ros\.Scan; got list"):
        initiator().process([1.0, 2.0])


def test_an_initiator_is_shown_in_one_line():
    made = initiator()
    for k in range(3):
        made.process(scan_at(12.0 * k, [HERE]))
    assert repr(made) == "Tracker(Tsepm, 3 scans, 1 tracks confirmed, 1 current)"


def test_track_ids_fit_32_bits():
    made = initiator()
    made.next_track_id = 2**32 - 1
    ids = []
    for k in range(6):
        ids += [track.track_id for track in made.process(scan_at(12.0 * k, [HERE]))]
    assert ids == [2**32 - 1, 0]


def test_ids_in_use_are_passed_over():
    made = initiator()
    confirmed, others = [], [(-3000.0, 0.0), (0.0, 3000.0)]
    for k in range(3):
        if k == 2:  # a downstream tracker has come to use ids that were not given yet
            far = ConfirmedTrack(0, 12.0, np.array([9e3, 0, 9e3, 0]), np.eye(4), (), 0.0)
            used = [replace(far, track_id=track_id) for track_id in (0, 2, 500)]
            made.maintenance.follow(12.0, TrackArrays.from_tracks(used))
        confirmed += made.process(scan_at(12.0 * k, [HERE, *others]))
    assert [track.track_id for track in confirmed] == [1, 3, 4]
    assert made.next_track_id == 5
    assert sorted(made.maintenance.confirmed.tracks.track_id) == [0, 1, 2, 3, 4, 500]


def test_a_track_says_when_where_and_from_what():
    made = initiator(window=5)
    for stamp, positions in [(100.0, [HERE]), (112.0, []), (130.0, [(-3000.0, 0.0), HERE])]:
        assert not made.process(scan_at(stamp, positions))
    (track,) = made.process(scan_at(140.0, [(0.0, 3000.0), (3000.0, 10.0)]))
    assert track.hits == ((0, 0), (2, 1), (3, 1))
    assert (track.stamp, track.age, track.scan_count) == (140.0, 40.0, 4)
    assert np.isnan(track.score)
    assert track.covariance.shape == (4, 4)
    np.testing.assert_allclose(track.position, [3000.0, 10.0], atol=5.0)


def test_a_changed_speed_counts_at_the_next_scan():
    made = initiator(max_speed=1.0)
    made.process(scan_at(0.0, [HERE]))
    kept = reconfigured(made, made.sensor.model, CommonOptions(max_speed=50.0), made.options)
    assert kept
    made.process(scan_at(12.0, [(3000.0, 500.0)]))
    assert made.statistics.started == 0


def test_a_smaller_window_ends_tracks_at_once_and_a_larger_one_keeps_them():
    made = initiator(min_hits=3, window=6)
    for k, seen in enumerate([[HERE], [], []]):
        made.process(scan_at(12.0 * k, seen))
    assert reconfigured(
        made, made.sensor.model, made.common, dataclasses.replace(made.options, window=20)
    )
    for k in range(3, 9):
        made.process(Scan(12.0 * k, [], []))
    assert made.statistics.potential_tracks == 1
    assert reconfigured(
        made, made.sensor.model, made.common, dataclasses.replace(made.options, window=9)
    )
    made.process(scan_at(108.0, [HERE]))
    assert made.statistics.started == 1, "nothing of before is there to gate"


def test_another_number_of_hits_starts_over_and_says_so():
    made = initiator()
    for k in range(2):
        made.process(scan_at(12.0 * k, [HERE]))
    options = dataclasses.replace(made.options, min_hits=2)
    assert not reconfigured(made, made.sensor.model, made.common, options)
    tracks = [made.process(scan_at(24.0 + 12.0 * k, [HERE])) for k in range(2)]
    assert [len(new) for new in tracks] == [0, 1]


def test_a_figure_of_the_sensor_is_asked_for_where_it_belongs():
    with pytest.raises(ValueError, match=r"clutter_density must be a text.*sensor.clutter_density"):
        make_initiator("score", sensor=SensorModel(), clutter_density=2e-4)
    with pytest.raises(ValueError, match=r"max_range is not an option.*mean sensor.max_range"):
        make_initiator("score", sensor=SensorModel(), max_range=300.0)


def test_a_limit_keeps_the_tightest_tracks():
    initiator = make_initiator(
        "tsepm", sensor=FIXED_RANGE_ERROR, min_hits=2, window=2, max_potential_tracks=1
    )
    initiator.process(scan_at(0.0, [(2000.0, 0.0)]))
    (track,) = initiator.process(scan_at(12.0, [(2000.0, 90.0), (2000.0, 5.0), (2000.0, -60.0)]))
    assert track.hits == ((0, 0), (1, 1))


def test_new_tracks_beyond_those_that_can_be_held_in_time_are_cut_and_counted():
    made = make_initiator("clutter_test", sensor=SensorModel(), clutter_test_size=0.9)
    made.max_scan_time = 0.004
    rng = np.random.default_rng(1)
    for k in range(5):
        made.process(Scan(12.0 * k, 5000 + rng.uniform(-100, 100, 5), rng.uniform(-0.02, 0.02, 5)))
    assert len(made.current) == made.statistics.confirmed == 0.05 * 0.004 * 100_000
    assert made.statistics.raw_confirmations == 0.25 * 0.004 * 100_000
    assert made.statistics.raw_confirmations + made.statistics.cut_confirmations > 5**5


def taken(made, scenes, interval=12.0):
    """Counts and new tracks of scans with detections at places, in order."""
    found = []
    for k, places in enumerate(scenes):
        new = made.process(scan_at(interval * k, places))
        found.append((made.statistics, new))
    return found


def test_measured_are_the_detections_in_the_coverage_at_their_places_in_the_fixed_frame():
    made, pose = initiator(), [1000.0, 0.0, np.pi / 2]
    made.process(scan_at(0.0, [HERE, (9500.0, 0.0), (9050.0, 0.0)], sensor_pose=pose))
    counts = made.statistics
    assert (counts.detections, counts.outside_coverage, counts.plots) == (2, 1, 2)
    seen = made.window[np.arange(2)]
    np.testing.assert_allclose(seen["position"], [[1000, 3000], [1000, 9050]], rtol=1e-3)
    assert seen["index"].tolist() == [0, 2]
    assert seen["scan"].tolist() == [0, 0]


def test_associated_are_detections_with_the_confirmed_tracks_which_follow_them():
    made = initiator()
    taken(made, [[(3000.0 + 50.0 * k, 0.0)] for k in range(3)])
    made.process(scan_at(36.0, [(0.0, 5000.0), (3150.0, 20.0)]))
    maintenance = made.maintenance
    assert [some.tolist() for some in maintenance.own_detections] == [[0], [1]]
    assert maintenance.confirmed.last_detected.tolist() == [36.0]
    x, y = made.current[0].position
    assert (3100.0 < x < 3200.0, 0.0 < y < 20.0) == (True, True), "between prediction and detection"
    made.process(scan_at(48.0, [(0.0, 5000.0)]))
    assert maintenance.confirmed.last_detected.tolist() == [36.0]
    assert made.current[0].position[0] == pytest.approx(x + 12.0 * 4.2, abs=5.0)


def test_learned_is_the_clutter_from_what_is_no_confirmed_target_s():
    targets = [(-3000.0, 0.0), (0.0, 3000.0), (-4000.0, 4000.0)]
    sensor = replace(FIXED_RANGE_ERROR, clutter_density=1e-7)
    made = make_initiator("score", sensor=sensor, clutter_density="estimated")
    taken(made, [targets] * 12)
    assert len(made.maintenance.confirmed) == 3
    quiet = made.sensor.clutter_density
    assert quiet * made.sensor.covered_area < 1.5, "the targets are not counted"
    rng = np.random.default_rng(0)
    for k in range(12, 24):
        clutter = rng.uniform(-6000.0, 6000.0, (200, 2)).tolist()
        made.process(scan_at(12.0 * k, [*targets, *clutter]))
    inside = 200.0 / 12_000.0**2
    assert 0.3 * inside < made.sensor.clutter_density < 1.5 * inside
    assert made.sensor.clutter_density > 10.0 * quiet


def test_split_is_a_potential_track_by_each_detection_in_its_gate():
    made = initiator()
    first, second = taken(made, [[HERE], [(3060.0, 0.0), (3000.0, 60.0), (0.0, 5000.0)]])
    assert (first[0].started, first[0].split) == (1, 1)
    assert (second[0].started, second[0].split, second[0].potential_tracks) == (1, 3, 3)
    assert {track.hits for track in made.potential_tracks()} == {((0, 0), (1, 0)), ((0, 0), (1, 1))}


def test_evaluated_and_pruned_are_paths_that_fit_no_straight_course():
    straight, bent = [[(3000.0, 100.0 * k)] for k in range(3)], [[HERE], [(3000.0, 200.0)]]
    (counts, new) = taken(initiator(), straight)[-1]
    assert (counts.evaluated, counts.raw_confirmations, counts.pruned) == (1, 1, 0)
    assert len(new) == 1
    (counts, new) = taken(initiator(), [*bent, [(3000.0, -20.0)]])[-1]
    assert (counts.evaluated, counts.pruned, counts.confirmed) == (1, 1, 0)
    assert len(new) == 0


def test_pruned_are_hypotheses_of_score_that_have_lost_their_target():
    made = make_initiator("score", sensor=FIXED_RANGE_ERROR)
    taken(made, [[HERE], *[[]] * 20])
    assert made.statistics.potential_tracks == 0
    assert (made.totals.started, made.totals.pruned, made.totals.terminated) == (1, 1, 0)


def test_confirmed_is_a_path_of_enough_hits_with_its_state_and_hits():
    made = initiator()
    before, now = taken(made, [[(3000.0, 60.0 * k)] for k in range(3)])[1:]
    assert (before[0].confirmed, now[0].confirmed) == (0, 1)
    (track,) = now[1]
    assert track.hits == ((0, 0), (1, 0), (2, 0))
    np.testing.assert_allclose(track.state, [3000.0, 0.0, 120.0, 5.0], atol=1.0)
    assert made.statistics.potential_tracks == 0, "the path is a track now"


def test_merged_are_the_tracks_of_one_target_in_a_scan():
    scenes = [[HERE], [(3050.0, 0.0)], [(3100.0, 0.0), (3110.0, 10.0)]]
    made = initiator()
    counts, new = taken(made, scenes)[-1]
    assert (counts.raw_confirmations, counts.merged, counts.confirmed) == (2, 1, 1)
    assert len(new) == 1
    assert 3100.0 < new[0].position[0] < 3110.0
    apart = [[place, (-x, y)] for ((x, y), *_) in scenes for place in [(x, y)]]
    counts, new = taken(initiator(), apart)[-1]
    assert (counts.merged, counts.confirmed) == (0, 2)


def test_a_track_is_sure_while_it_probably_exists_and_then_coasts_for_some_scans():
    made = make_initiator("score", sensor=FIXED_RANGE_ERROR)
    taken(made, [[(3000.0 + 50.0 * k, 0.0)] for k in range(6)])
    (track,) = made.current
    assert track.existence_probability > 0.9
    sure, published, remembered = [], [], []
    for k in range(6, 60):
        made.process(scan_at(12.0 * k, []))
        published += made.current.existence_probability.tolist()
        sure += made.current.sure.existence_probability.tolist()
        remembered += made.maintenance.confirmed.existence.tolist()
        if not len(made.maintenance.confirmed):
            break
    assert (2 < len(sure) < len(published) < 12, len(remembered)) == (True, 50)
    assert published == remembered[: len(published)] and sure == remembered[: len(sure)]
    assert remembered == sorted(remembered, reverse=True)
    assert min(sure) >= 0.5 > remembered[len(sure)]
    assert min(published) >= 0.3 > remembered[len(published)]
    assert (made.maintenance.ended, track.track_id) == ({}, 0), "its end was told before"


def test_a_track_that_comes_back_is_published_again_under_its_id_and_is_no_new_track():
    made = make_initiator("score", sensor=FIXED_RANGE_ERROR)
    there, gone = [[(3000.0 + 50.0 * k, 0.0)] for k in range(40)], [[]] * 14
    steps = taken(made, [*there[:8], *gone, *there[22:30]])
    assert [track.track_id for _, new in steps for track in new] == [0]
    assert made.current.track_id.tolist() == [0] and made.current.revision[0] >= 1


def test_what_was_learned_outlives_the_tracks_but_no_reset():
    near = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=0.005, max_range=500.0)
    made = make_initiator("score", sensor=near, max_speed=10.0)

    def known() -> tuple[float, float]:
        return made.method.threshold, made.maintenance.manoeuvre.process_noise(made.common, 1.0)

    fresh, rng = known(), np.random.default_rng(0)
    for k in range(60):
        turns = np.array([100.0, -150.0]) + 40.0 * np.exp(0.1j * k * np.array([1.0, -1.0]))
        range_ = np.abs(turns) + rng.normal(size=2)
        made.process(Scan(float(k), range_, np.angle(turns) + 0.005 * rng.normal(size=2)))
    learned = known()
    assert learned[0] < fresh[0] == math.inf and learned[1] != fresh[1]
    made.forget_potential_tracks()
    made.maintenance.clear()
    assert known() == learned and not len(made.current)
    made.reset()
    assert known() == fresh


def test_a_scan_that_is_not_later_changes_nothing():
    made = initiator()
    taken(made, [[HERE]] * 2)
    with pytest.raises(ValueError, match="stamp"):
        made.process(scan_at(12.0, [HERE]))
    assert (made.stamp, made.scan_index, made.totals.scans) == (12.0, 1, 2)


def standing_scene(first: int, unknown: int = 0, **options):
    """`score` on an echo that stays, which stands from scan `first` on: ids, and counts.

    In the first `unknown` scans the detector does not know what stands.
    """
    made = make_initiator("score", sensor=SensorModel(max_range=100.0), max_speed=2.0, **options)
    rng, ids, counts = np.random.default_rng(1), [], []
    for k in range(30):
        range_ = np.append(40.0 + rng.normal(0.0, 0.1), rng.uniform(5.0, 100.0, 4))
        standing = np.append(float(k >= first), np.zeros(4))
        standing[:] = np.nan if k < unknown else standing
        azimuth = np.append(0.5, rng.uniform(-3.0, 3.0, 4))
        made.process(Scan(float(k), range_, azimuth, features={"standing": standing}))
        ids.append(made.current.track_id.tolist())
        counts.append(made.statistics.standing)
    return ids, counts


def test_what_stands_starts_no_track_unless_wanted():
    ids, counts = standing_scene(0)
    assert ids[-1] == [] and counts == [1] * 30, "each is counted"
    ids, counts = standing_scene(0, start_standing="on")
    assert len(ids[-1]) == 1 and counts == [0] * 30


def test_what_stands_starts_no_track_by_a_scan_of_another_sensor():
    """The best hypothesis may have missed the newest scan, and end in one before."""
    near = SensorModel(range_std=0.1, range_std_fraction=0.0, azimuth_std=0.005, max_range=100.0)
    made = make_initiator(
        "score", sensor={"a": near, "b": near}, max_speed=3.0, clutter_density="given"
    )
    rng = np.random.default_rng(0)
    for k in range(24):
        place = [36.0 + 0.1 * rng.normal()], [1.0 + 0.005 * rng.normal()]
        stands = {"standing": [np.nan if k < 2 else 1.0]}
        assert not len(made.process(Scan(0.25 * k, *place, features=stands, sensor="ab"[k % 2])))


def test_a_track_continues_on_a_target_that_comes_to_stand():
    ids, _ = standing_scene(18)
    assert ids[17] == ids[-1] and len(ids[-1]) == 1


def test_detections_of_which_it_is_unknown_whether_they_stand_start_tracks_as_all_do():
    assert standing_scene(99, unknown=30) == standing_scene(99)


def test_what_stands_is_not_learned_as_clutter():
    """Else the density around a quay hides what moves there."""
    weights = []
    for standing in (0.0, 1.0):
        made = make_initiator("score", sensor=SensorModel(max_range=100.0), max_speed=2.0)
        places = np.full(20, 50.0), np.linspace(-1.0, 1.0, 20)
        for k in range(5):
            made.process(Scan(float(k), *places, features={"standing": np.full(20, standing)}))
        weights.append(made.sensor.clutter_density)
    assert weights[1] < 0.1 * weights[0]


def test_a_track_that_coasts_ends_no_other_beside_it():
    options = {"target_extent": 30.0, "false_tracks_per_hour": 10.0}
    made, ended = make_initiator("score", sensor=FIXED_RANGE_ERROR, **options), {}
    for k in range(40):
        first = [(3000.0 + 50.0 * k, 0.0)] * (k < 12)
        second = [(3000.0 + 50.0 * k, 250.0)] * (k >= 6)
        made.process(scan_at(12.0 * k, [*first, *second]))
        ended |= made.maintenance.ended
    lost, other = made.maintenance.confirmed.tracks
    assert [lost.status, other.status] == [TrackStatus.COASTING, TrackStatus.CONFIRMED]
    assert other.track_id == 1
    assert "duplicate" not in ended.values()


def swum(stated: float, errors: str = "learned", method: str = "score", pings: int = 120):
    """Ids, deviation of the place over that stated, and the initiator, of a target alone.

    The errors are stated as a factor of the true ones.
    """
    rng = np.random.default_rng(8)
    sensor = SensorModel(
        range_std=0.2 * stated, range_std_fraction=0.0, azimuth_std=0.01 * stated, max_range=60.0
    )
    made = make_initiator(method, sensor=sensor, max_speed=2.0, sensor_errors=errors)
    ids, square = set(), []
    for ping in range(pings):
        place = np.array([20.0 - 0.1 * ping, 15.0 + 0.05 * ping])
        range_, azimuth = np.hypot(*place), np.arctan2(place[1], place[0])
        error = rng.standard_normal(2)
        scan = Scan(0.2 * ping, [range_ + 0.2 * error[0]], [azimuth + 0.01 * error[1]])
        made.process(scan)
        ids |= {*made.current.track_id.tolist()}
        for state, covariance in zip(made.current.state, made.current.covariance, strict=True):
            away = state[0::2] - place
            square.append(away @ np.linalg.solve(covariance[0::2, 0::2], away))
    return ids, float(np.mean(square[len(square) // 2 :])) / 2.0, made


@pytest.mark.parametrize("stated", [0.5, 1.0, 2.0])
def test_errors_that_are_stated_wrong_are_learned_and_used(stated):
    ids, square, made = swum(stated)
    of_given, square_of_given, _ = swum(stated, "given")
    assert len(ids) <= len(of_given)
    assert abs(math.log(square)) <= abs(math.log(square_of_given)) + 0.5 * (stated == 1.0)
    assert 0.2 < square < 2.0
    assert made.sensor.model.azimuth_std == 0.01 * stated, "as given"
    assert made.method.sensor.azimuth_std == pytest.approx(0.01, rel=0.35)
    assert made.method.sensor.range_std == pytest.approx(0.2, rel=0.45)
    made.reset()
    assert made.method.sensor == made.sensor.model


def test_errors_that_are_given_stay():
    _, square, made = swum(0.5, "given")
    assert made.method.sensor == made.sensor.model
    assert square > 1.5
    assert swum(0.5, method="tsepm")[2].method.sensor.azimuth_std == 0.005


def test_learned_errors_are_followed_up_to_a_factor_of_four():
    _, _, made = swum(0.01)
    assert made.method.sensor.azimuth_std <= 4.001 * 0.0001
