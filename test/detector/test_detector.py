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
"""The detector: the number of false detections, and what is measured of echoes."""

import numpy as np
import pytest
from scipy import ndimage

from tsepm_ros import SonarImage, make_detector

B, M = 64, 200

RANGE, AZIMUTH = 1.0 + 0.1 * np.arange(M), np.linspace(-1.0, 1.0, B)

D_AZIMUTH = AZIMUTH[1] - AZIMUTH[0]

POINT = {"azimuth_extent": 1e-3, "range_extent": 1e-3}


def noise(rng, gain=1.0):
    """Rayleigh amplitudes of mean power 1."""
    white = rng.standard_normal((2, B, M)) * np.sqrt(0.5)
    return gain * np.hypot(*white)


def with_echo(image, row, column, db, size=(1, 1)):
    image[row : row + size[0], column : column + size[1]] = 10 ** (db / 20)
    return image


def images(count, make):
    for k in range(count):
        yield SonarImage(float(k), RANGE, AZIMUTH, make(k))


def false_ratio(pictures, after=20):
    """Detections of pictures of noise, over the ten that are wished for."""
    detector = make_detector(false_detections_per_ping=10.0, **POINT)
    counts = [len(detector.process(image)) for image in pictures]
    return np.mean(counts[after:]) / 10.0


SCALES = {
    "power": lambda a: a**2,
    "logarithm of 8 bits": lambda a: np.clip(90 + 40 * np.log10(a), 0, 255).astype(np.uint8),
    "gain of each bearing": lambda a: a * np.random.default_rng(3).uniform(0.2, 5.0, (B, 1)),
    "tiny": lambda a: 1e-30 * a,
}

LIMITS = {
    "min_range": (5.0, lambda r, a: r > 4.9),
    "max_range": (15.0, lambda r, a: r < 15.1),
    "azimuth_min": (-0.4, lambda r, a: a > -0.4 - D_AZIMUTH),
    "azimuth_max": (0.4, lambda r, a: a < 0.4 + D_AZIMUTH),
}


@pytest.mark.parametrize("limit", LIMITS)
def test_nothing_is_detected_beyond_a_limit_of_the_coverage(limit):
    value, inside = LIMITS[limit]
    image = SonarImage(0.0, RANGE, AZIMUTH, noise(np.random.default_rng(6)))
    given = POINT | {"false_detections_per_ping": 200}
    whole, part = (make_detector(**given, **more).process(image) for more in ({}, {limit: value}))
    assert len(whole) > 100 and not inside(whole.range, whole.azimuth).all()
    assert len(part) > 50 and inside(part.range, part.azimuth).all()


def test_a_coverage_without_a_cell_is_said_and_a_model_of_errors_is_no_option():
    image = SonarImage(0.0, RANGE, AZIMUTH, noise(np.random.default_rng(1)))
    with pytest.raises(
        ValueError, match="no cell of the image is in the coverage, which min_range"
    ):
        make_detector(min_range=50.0).process(image)
    with pytest.raises(ValueError, match=r"no option 'range_std'; it has .* azimuth_max"):
        make_detector(range_std=1.0)


@pytest.mark.parametrize("scale", SCALES)
def test_the_stated_number_of_false_detections_is_kept_on_any_scale(scale):
    rng = np.random.default_rng(1)
    assert 2 / 3 < false_ratio(images(60, lambda k: SCALES[scale](noise(rng)))) < 1.5


def test_strong_targets_do_not_raise_the_threshold():
    rng, found = np.random.default_rng(2), []
    detector = make_detector(false_detections_per_ping=5, **POINT)

    def picture(k):
        image = noise(rng)
        for n in range(5):
            with_echo(image, 8 + 11 * n, 20 + 30 * n + k // 2, 20.0)
        return image

    for k, image in enumerate(images(60, picture)):
        scan = detector.process(image)
        own = np.zeros(len(scan), bool)
        for n in range(5):
            near = abs(scan.range - RANGE[20 + 30 * n + k // 2]) < 0.25
            own |= near & (abs(scan.azimuth - AZIMUTH[8 + 11 * n]) < 2.5 * D_AZIMUTH)
        found.append((own.sum(), (~own).sum()))
    targets, false = np.mean(found[20:], axis=0)
    assert targets > 4.5
    assert 2 / 3 < false / 5 < 1.5


def test_after_a_step_of_the_gain_the_number_is_kept_within_five_images():
    rng = np.random.default_rng(4)
    log = lambda a: np.clip(60 + 40 * np.log10(a), 0, 255).astype(np.uint8)  # noqa: E731
    pictures = images(60, lambda k: log(noise(rng, 1.0 if k < 40 else 10.0)))
    assert 2 / 3 < false_ratio(pictures, after=45) < 1.5


def test_an_echo_is_measured_where_it_is_as_wide_as_it_is_and_as_strong_as_it_is():
    rng = np.random.default_rng(5)
    detector = make_detector(azimuth_extent=4 * D_AZIMUTH, range_extent=1.0)
    picture = lambda k: with_echo(noise(rng), 30, 100, 15.0, (4, 10))  # noqa: E731
    [image] = images(1, picture)
    scan = detector.process(image)
    best = int(np.argmax(scan.features["intensity"]))
    assert scan.range[best] == pytest.approx(RANGE[100:110].mean(), abs=0.1)
    assert scan.azimuth[best] == pytest.approx(AZIMUTH[30:34].mean(), abs=0.5 * D_AZIMUTH)
    assert scan.features["range_width"][best] == pytest.approx(1.0, rel=0.2)
    assert scan.features["azimuth_width"][best] == pytest.approx(4 * D_AZIMUTH, rel=0.2)
    assert 11.0 < scan.features["intensity"][best] < 17.0  # it raises its own background a little
    assert 0.02 < scan.range_std[best] < 0.5


def test_errors_of_a_point_are_as_stated():
    rng, errors = np.random.default_rng(6), []
    detector = make_detector(**POINT)
    grid = np.arange(B)[:, None], np.arange(M)
    for k in range(70):
        row, column = 32 + rng.uniform(-20, 20), 100 + rng.uniform(-80, 80)
        echo = np.exp(-0.5 * ((grid[0] - row) ** 2 + (grid[1] - column) ** 2) / 0.6**2)
        field = 10.0 * echo + noise(rng) * np.exp(2j * np.pi * rng.random((B, M)))
        scan = detector.process(SonarImage(float(k), RANGE, AZIMUTH, np.abs(field)))
        best = int(np.argmax(scan.features["intensity"]))
        errors.append((scan.range[best] - 1.0 - 0.1 * column) / scan.range_std[best])
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.3


def test_images_that_show_nothing_but_echoes_have_no_other_detections():
    """Such as of a radar whose gain keeps its background black."""

    def radar(k):
        shown = with_echo(np.zeros((B, M)), 20, 60 + 2 * k, 40.0, (3, 4))
        return with_echo(shown, 45, 120, 30.0, (4, 5))

    detector = make_detector(false_detections_per_ping=10.0)
    for k, image in enumerate(images(40, radar)):
        scan = detector.process(image)
        places = [(AZIMUTH[21], RANGE[61 + 2 * k]), (AZIMUTH[46], RANGE[122])]
        for place in np.stack([scan.azimuth, scan.range], axis=1):
            assert min(np.abs((place - each) / (0.15, 0.8)).max() for each in places) < 1.0, k
        assert len(scan), k


def test_a_streak_of_a_single_bearing_hardly_changes_the_number():
    rng = np.random.default_rng(7)

    def picture(k):
        image = noise(rng)
        image[rng.integers(B)] *= 10.0
        return image

    assert 2 / 3 < false_ratio(images(60, picture)) < 1.5


def hits(pictures, row, column):
    """Images of which a detection is at an echo."""
    detector, near = make_detector(), []
    for image in pictures:
        scan = detector.process(image)
        apart = abs(scan.range - RANGE[column]), abs(scan.azimuth - AZIMUTH[row])
        near.append(((apart[0] < 0.3) & (apart[1] < 2.0 * D_AZIMUTH)).any())
    return sum(near)


@pytest.mark.parametrize("decades", [0.0, 8.0])
def test_powers_without_a_gain_over_range_have_the_same_detections_at_all_ranges(decades):
    rng, loss = np.random.default_rng(31), np.logspace(0.0, -decades, M)
    powers = (loss * with_echo(noise(rng), 30, 180, 15.0, (2, 4)) ** 2 for _ in range(5))
    assert hits(images(5, lambda k: next(powers).astype(np.float32)), 30, 180) == 5


def test_a_cell_far_brighter_than_all_others_hides_no_echo_around_it():
    rng = np.random.default_rng(32)
    echoes = [with_echo(noise(rng), 30, 120, 15.0, (2, 4)) for _ in range(12)]
    for k, image in enumerate(echoes):
        image[20 + k, 125] = 1e9
    assert hits(images(12, lambda k: echoes[k].astype(np.float32)), 30, 120) >= 11


@pytest.mark.parametrize("value", [np.nan, 7.0])
def test_an_image_of_one_value_is_an_empty_scan_and_counted(value):
    detector = make_detector()
    scan = detector.process(SonarImage(0.0, RANGE, AZIMUTH, np.full((B, M), value)))
    assert len(scan) == 0
    assert detector.measured["empty"] == detector.measured["images"] == 1
    rng = np.random.default_rng(1)
    assert len(detector.process(SonarImage(1.0, RANGE, AZIMUTH, noise(rng)))) >= 4


@pytest.mark.parametrize("shape", [(1, 300), (3, 100), (100, 2)])
def test_images_of_few_cells_pass(shape):
    rng, detector = np.random.default_rng(11), make_detector(false_detections_per_ping=5)
    axes = np.linspace(1, 9, shape[1]), np.linspace(0, 1, shape[0])
    scans = [detector.process(SonarImage(k, *axes, rng.random(shape))) for k in range(40)]
    assert max(map(len, scans)) <= 40


def test_times_and_poses_of_bearings_are_those_of_their_detections():
    rng = np.random.default_rng(12)
    after, poses = np.linspace(0.0, 1.0, B), np.zeros((B, 3))
    poses[:, 0] = after
    image = with_echo(noise(rng), 40, 100, 30.0)
    scan = make_detector().process(SonarImage(5.0, RANGE, AZIMUTH, image, after, poses))
    best = int(np.argmax(scan.features["intensity"]))
    assert scan.time_offset[best] == pytest.approx(after[40], abs=0.02)
    assert scan.sensor_pose[best, 0] == scan.time_offset[best]


def test_a_full_turn_has_no_seam():
    rng = np.random.default_rng(13)
    azimuth = -2 * np.pi * np.arange(B) / B
    image = noise(rng)
    image[[0, 1, -1], 100:105] = 8.0
    detector = make_detector(azimuth_extent=6 * np.pi / B, range_extent=0.5)
    scan = detector.process(SonarImage(0.0, RANGE, azimuth, image))
    near = (abs(scan.range - RANGE[102]) < 0.5) & (abs(scan.azimuth) < 0.3)
    assert near.sum() == 1


@pytest.mark.parametrize("rows", [[0, -1], [-2, -1, 0, 1], [-3, -2, -1], [-1, 0, 1, 2]])
@pytest.mark.parametrize("way", [1, -1])
def test_an_echo_on_the_seam_of_a_full_turn_is_where_it_is(rows, way):
    azimuth, image = way * 2 * np.pi * np.arange(B) / B, noise(np.random.default_rng(13))
    image[rows, 100:105] = 30.0
    detector = make_detector(azimuth_extent=8 * np.pi / B, range_extent=0.5)
    after = np.linspace(0.0, 1.0, B)
    scan = detector.process(SonarImage(0.0, RANGE, azimuth, image, after))
    best = np.argmax(scan.features["intensity"])
    place = way * scan.azimuth[best] * B / (2 * np.pi)
    assert place == pytest.approx(np.mean(rows), abs=0.25)
    assert scan.time_offset[best] == after[round(place)]


def test_other_ranges_in_a_run_are_learned_anew():
    rng = np.random.default_rng(14)
    detector = make_detector(false_detections_per_ping=10)
    counts = []
    for k in range(12):
        scale = 1.0 if k < 6 else 2.0
        image = SonarImage(float(k), scale * RANGE, AZIMUTH, noise(rng))
        counts.append(len(detector.process(image)))
    assert max(counts[7:]) < 30


def standing_scene(rng, shadow=1.0, bearings=slice(30, 33)):
    """Noise with a wall and a pile, and a shadow behind the pile."""
    image = noise(rng)
    image[:, 180:184] *= 3.0
    image[bearings, 100:104] *= 10.0
    image[bearings, 104:] *= shadow
    return image


def test_a_shadow_brings_no_detections_in_front_of_what_casts_it():
    rng, counts = np.random.default_rng(21), []
    detector = make_detector(false_detections_per_ping=10, **POINT)
    for image in images(50, lambda k: standing_scene(rng, 0.3)):
        scan = detector.process(image)
        ahead = (scan.range < RANGE[95]) & (abs(scan.azimuth - AZIMUTH[31]) < 1.6 * D_AZIMUTH)
        counts.append(np.count_nonzero(ahead))
    share = 3 * 95 / (B * M)
    assert np.mean(counts[20:]) < 2.5 * 10 * share + 0.1


def test_the_ground_beside_a_shadow_that_moves_does_not_look_bright():
    rng = np.random.default_rng(14)
    ground = np.exp(0.4 * np.kron(rng.standard_normal((16, 38)), np.ones((4, 4))))[:, :150]
    azimuth, range_ = np.radians(np.linspace(-30.0, 30.0, 64)), 2.0 + 0.1 * np.arange(150)
    detector, beside = make_detector(slowest_speed=0.1), []
    for k in range(90):
        level, row = ground.copy(), 20 + max(k - 60, 0) // 6
        level[row : row + 8, 60:] *= 0.3 if k >= 60 else 1.0
        amplitude = level * rng.rayleigh(0.7, level.shape)
        detector.process(SonarImage(0.2 * k, range_, azimuth, amplitude))
        smoothed = detector.stages.smoothed[:, 60:]
        beside.append(np.mean([smoothed[row - 5 : row - 1], smoothed[row + 9 : row + 13]]))
    assert abs(np.mean(beside[75:])) < 0.08, "0.17 where the shadow darkens the rings around them"


def test_what_stands_is_flagged_and_then_background_and_the_number_is_of_what_does_not():
    rng, seen = np.random.default_rng(22), []
    detector = make_detector(false_detections_per_ping=5, range_extent=0.4, azimuth_extent=0.09)
    for image in images(120, lambda k: standing_scene(rng)):
        scan = detector.process(image)
        stands = scan.features["standing"] > 0.8
        pile = (abs(scan.range - RANGE[101]) < 0.5) & (abs(scan.azimuth - AZIMUTH[31]) < 0.12)
        seen.append((np.any(pile & stands), stands.sum(), (~stands).sum(), np.any(pile)))
    flagged, stood, _, delivered = np.mean(seen[20:60], axis=0)
    assert flagged > 0.6 and delivered > 0.95, "what the background would remove is told at first"
    assert 2 / 3 < np.mean(seen[20:], axis=0)[2] / 5 < 1.5
    assert np.mean(seen[70:], axis=0)[1] < 0.2 * stood
    numbers = detector.measured["detections"], detector.measured["standing"]
    assert numbers == pytest.approx(np.mean(seen[80:], axis=0)[[2, 1]], abs=1.0)


def test_in_the_first_images_what_stands_is_measured_as_if_no_image_had_been_before():
    rng, loud = np.random.default_rng(26), []
    detector = make_detector(false_detections_per_ping=5, range_extent=0.4, azimuth_extent=0.09)
    for image in images(15, lambda k: standing_scene(rng)):
        scan = detector.process(image)
        pile = (abs(scan.range - RANGE[101]) < 0.5) & (abs(scan.azimuth - AZIMUTH[31]) < 0.12)
        loud.append(scan.features["intensity"][pile].min(initial=np.inf))
    assert np.median(loud[4:]) > np.mean(loud[:3]) - 2.5


def test_a_target_in_front_of_a_wall_is_detected_where_the_wall_is_known():
    rng, found = np.random.default_rng(23), []
    detector = make_detector(false_detections_per_ping=5, range_extent=0.4, azimuth_extent=0.09)

    def picture(k):
        image = standing_scene(rng)
        image[5 + k // 2 : 8 + k // 2, 180:184] += 8.0
        return image

    for k, image in enumerate(images(90, picture)):
        scan = detector.process(image)
        near = abs(scan.azimuth - AZIMUTH[6 + k // 2]) < 3.5 * D_AZIMUTH
        moves = scan.features["standing"] <= 0.8
        found.append((near & moves & (abs(scan.range - RANGE[181]) < 0.4)).any())
    assert np.mean(found[20:]) > 0.9


@pytest.mark.parametrize("size", [(1, 1), (5, 15)])
def test_the_learned_extent_does_not_depend_on_the_stated_number(size):
    learned = set()
    for number in (3.0, 12.0):
        rng = np.random.default_rng(24)

        def picture(k, rng=rng):
            image = noise(rng)
            for n in range(4):
                row, column = 8 + 14 * n, 20 + 40 * n + 3 * k // 2
                image[row : row + size[0], column : column + size[1]] += 14.0 / np.sqrt(
                    np.prod(size)
                )
            return image

        detector = make_detector(false_detections_per_ping=number)
        for image in images(22, picture):
            detector.process(image)
        values = detector.measured
        learned.add(
            (round(values["azimuth_extent"] / D_AZIMUTH), round(values["range_extent"] / 0.1))
        )
    assert len(learned) == 1


CHANGES = {
    "bearings": lambda r, a, i: (r, a + 0.3, i),
    "ranges": lambda r, a, i: (r + 2.0, a, i),
    "spacing": lambda r, a, i: (2.0 * r, a, i),
    "size": lambda r, a, i: (r[:-20], a, i[:, :-20]),
    "one cell less": lambda r, a, i: (r[:-1], a, i[:, :-1]),
}


@pytest.mark.parametrize("change", CHANGES)
def test_any_other_axis_means_learning_anew_and_is_said_once(change):
    rng, stood = np.random.default_rng(25), []
    detector = make_detector(false_detections_per_ping=5, **POINT)
    for k in range(27):
        axes = RANGE, AZIMUTH, with_echo(noise(rng), 30, 100, 25.0, (3, 3))
        axes = CHANGES[change](*axes) if 20 <= k < 26 else axes
        scan = detector.process(SonarImage(float(k), *axes))
        stood.append(np.count_nonzero(scan.features["standing"] > 0.8))
    assert max(stood[10:20]) > 0
    assert max(stood[20:23]) == stood[26] == 0
    assert len(detector.notes) == 1 and "begins to learn again" in detector.notes[0]


def test_settings_that_alternate_are_said_while_they_do():
    rng, detector, said = np.random.default_rng(30), make_detector(**POINT), []
    for k in range(40):
        distance = RANGE if k > 20 or k % 2 else 2.0 * RANGE
        detector.process(SonarImage(float(k), distance, AZIMUTH, noise(rng)))
        said.append(detector.begins_again)
    assert not any(said[:10]) and all(said[10:30]) and not any(said[31:])
    assert "changed 20 times" in said[20] and said[20].endswith("alternate on one topic?")


def over_the_ground(motion: float, known: float, images: int = 45):
    """Detections of a sonar that drives along a rough ground, a part with a target, by images.

    `known` is the standard deviation of the errors of its poses, m.
    """
    rng, n = np.random.default_rng(4), 600
    ground = np.exp(1.2 * ndimage.zoom(rng.standard_normal((n // 6, n // 6)), 6, order=1))
    azimuth, distance = np.linspace(-0.9, 0.9, 64), np.linspace(1.0, 30.0, 180)
    detector = make_detector(
        false_detections_per_ping=3.0, range_extent=0.6, azimuth_extent=3 * 1.8 / 64
    )
    found = []
    for k in range(images):
        x = motion * k
        index = [
            ((place + 75.0) / 0.25).astype(int)
            for place in (
                x + np.outer(np.cos(azimuth), distance),
                np.outer(np.sin(azimuth), distance),
            )
        ]
        level = np.sqrt(ground[tuple(index)])
        amplitude = rng.rayleigh(size=(64, 180)) * level
        row, column = 6 + k % 50, 30 + 2 * (k % 60)
        amplitude[row - 1 : row + 2, column - 2 : column + 3] += 2.0 * level[row, column]
        pose = (x + known * rng.standard_normal(), known * rng.standard_normal(), 0.0)
        scan = detector.process(SonarImage(0.1 * k, distance, azimuth, amplitude, sensor_pose=pose))
        near = (np.abs(scan.azimuth - azimuth[row]) < 0.06) & (
            np.abs(scan.range - distance[column]) < 0.6
        )
        found.append((bool(near.any()), int((~near & (scan.features["standing"] < 0.8)).sum())))
    return np.mean(found[20:], axis=0)


def test_poses_give_a_moving_sonar_the_background_of_the_ground():
    seen, others = over_the_ground(0.2, 0.0)
    assert seen > 0.8 and others < 9.0
    assert over_the_ground(0.2, 0.4)[0] > seen - 0.1, "errors of poses are found in the images"
    assert over_the_ground(0.2, 1e4)[0] < seen - 0.3, "with poses that are wrong as without"


def test_it_is_known_what_stands_however_the_stamps_are_rounded():
    """The slowest target leaves these places in 4 to 6 s; the background remembers 4 s."""
    rng, axes = np.random.default_rng(6), (0.1 * np.arange(1, 201), np.linspace(-1.0, 1.0, 64))
    detector, unknown = make_detector(slowest_speed=0.08, **POINT), []
    for k in range(160):
        scan = detector.process(SonarImage(0.1 * k, *axes, rng.rayleigh(size=(64, 200))))
        unknown.append(np.isnan(scan.features["standing"])[np.abs(scan.range - 6.2) < 0.8].any())
    assert not any(unknown[70:])


def flickering(shift):
    """How far echoes of six images in ten at fixed places stand; stamps are shifted, s."""
    rng, standing = np.random.default_rng(31), list[float]()
    detector = make_detector(slowest_speed=0.5, **POINT)
    for k in range(75):
        image = noise(rng)
        for row, column in zip(range(5, 60, 6), range(12, 190, 18), strict=True):
            image[row : row + 2, column : column + 3] += 7.0 * (rng.random() < 0.6)
        scan = detector.process(SonarImage(5000.0 + 0.5 * k + shift(k), RANGE, AZIMUTH, image))
        standing += [*scan.features["standing"]] * (k >= 45)
    return np.array(standing)


LEAPS = {
    "set back": lambda k: -600.0 * (k >= 45),
    "set ahead": lambda k: 3600.0 * (k >= 45),
    "one ahead": lambda k: 3600.0 * (k == 45),
    "one back": lambda k: -3600.0 * (k == 45),
    "again and again": lambda k: -5.0 * (k // 10),
}


@pytest.fixture(scope="module")
def usual():
    return flickering(lambda k: 0.0)


@pytest.mark.parametrize("leap", LEAPS)
def test_it_is_known_what_stands_wherever_the_clock_is_set(usual, leap):
    leapt = flickering(LEAPS[leap])
    assert len(leapt) == len(usual) and np.isfinite(leapt).all()
    assert np.abs(leapt - usual).max() < 0.25


def test_a_pause_is_time_that_passed():
    rng, standing = np.random.default_rng(32), {}
    for pause in (0.0, 300.0):
        detector = make_detector(slowest_speed=0.5, **POINT)
        for k in range(42):
            image = with_echo(noise(rng), 30, 100, 25.0 if k > 39 else 0.0, (2, 3))
            stamp = 0.5 * k + pause * (k > 40)
            scan = detector.process(SonarImage(stamp, RANGE, AZIMUTH, image))
        standing[pause] = scan.features["standing"][np.argmax(scan.features["intensity"])]
    assert standing[0.0] < 0.5 < standing[300.0], "it was there for longer than a look-back"


def test_poses_that_tremble_take_nothing_from_a_sonar_at_rest():
    exact, trembling = (over_the_ground(0.0, known) for known in (0.0, 2.0))
    assert trembling[0] >= exact[0] - 0.05 and trembling[1] < exact[1] + 1.0


def changed_range(**more):
    """A detector after 20 images and 10 of half the range, and when all were known to stand."""
    rng, places = np.random.default_rng(6), np.random.default_rng(7)
    rows, cells = places.integers(3, 61, 10), places.uniform(20, 190, 10)
    detector = make_detector(false_detections_per_ping=5, slowest_speed=0.2, **POINT)
    known = []
    for k in range(30):
        image, factor = rng.rayleigh(size=(64, 400)), 1.0 if k < 20 else 2.0
        for row, cell in zip(rows, (factor * cells).astype(int), strict=True):
            image[row - 2 : row + 3, cell - 3 : cell + 4] += rng.rayleigh(5.0, (5, 7))
        axes = 0.1 * np.arange(1, 401), np.linspace(-1.0, 1.0, 64)
        scan = detector.process(SonarImage(float(k), *axes, image, **more))
        known.append(not np.isnan(scan.features["standing"]).any())
    return detector, known


def test_a_change_of_the_range_that_the_images_do_not_state_is_said_and_nothing_else_is_done():
    detector, known = changed_range()
    (note,) = detector.notes
    assert detector.factor == pytest.approx(2.0, rel=0.03)
    assert "at 22.000 s" in note and "2 times" in note and "to 0.5 of that before" in note
    assert all(known[15:]), "what was learned stays"


def test_ranges_that_the_messages_state_are_believed():
    detector, known = changed_range(states_ranges=True)
    assert (detector.notes, detector.factor, all(known[15:])) == ([], 1.0, True)


def test_walls_do_not_hide_what_moves_from_a_slow_scanner():
    """What is one thing along bearing does not set the threshold in the first turns."""
    rng, seen = np.random.default_rng(28), []
    detector = make_detector(false_detections_per_ping=5, range_extent=0.4, azimuth_extent=0.09)
    for k in range(14):
        image = noise(rng)
        for beam in range(B):
            wall = 120 + 2 * abs(beam - 32)
            image[beam, wall : wall + 6] *= 8.0
        row, column = 5 + 4 * k, 100 - 4 * (k % 5)
        image[row : row + 3, column : column + 4] += rng.rayleigh(0.8, (3, 4))
        scan = detector.process(SonarImage(8.0 * k, RANGE, AZIMUTH, image))
        near = abs(scan.range - RANGE[column + 1]) < 0.4
        seen.append((near & (abs(scan.azimuth - AZIMUTH[row + 1]) < 3 * D_AZIMUTH)).any())
    assert np.mean(seen) > 0.8


@pytest.mark.parametrize(
    ("rate", "images", "kept"), [(1, 9, False), (1, 10, True), (40, 39, False)]
)
def test_it_is_said_that_the_first_images_do_not_keep_the_number(rate, images, kept):
    rng, detector = np.random.default_rng(29), make_detector()
    for k in range(images):
        detector.process(SonarImage(k / rate, RANGE, AZIMUTH, noise(rng)))
    assert ("is kept from image 10 and 1 s on" in detector.kinds()) is not kept
