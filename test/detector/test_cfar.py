"""TODO: one sentence on what is shown of cfar."""

import numpy as np

from tsepm_ros import SonarImage, make_detector

B, M = 64, 200

RANGE, AZIMUTH = 1.0 + 0.1 * np.arange(M), np.linspace(-1.0, 1.0, B)

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


def test_a_clutter_map_takes_away_what_stands_and_the_default_does_not():
    rng = np.random.default_rng(8)
    seen = []
    for pings in (0, 20):
        detector = make_detector(**POINT, clutter_map=pings)
        picture = lambda k: with_echo(noise(rng), 30, 100, 15.0)  # noqa: E731
        scans = [detector.process(image) for image in images(40, picture)]
        seen.append(np.mean([(abs(s.range - RANGE[100]) < 0.15).any() for s in scans[20:]]))
    assert seen[0] > 0.9
    assert seen[1] < 0.6


def test_nothing_is_detected_where_nothing_was_measured():
    rng = np.random.default_rng(10)

    def picture(k):
        image = noise(rng)
        image[:, :80] = np.nan
        return image

    detector = make_detector()
    for image in images(5, picture):
        scan = detector.process(image)
        assert len(scan)
        assert scan.range.min() > RANGE[78]


def test_cells_that_tremble_are_the_same_cells():
    rng = np.random.default_rng(16)
    detector = make_detector(**POINT, false_detections_per_ping=5)
    counts = set()
    for k in range(12):
        distance = RANGE * (1.0 + 1e-4 * rng.standard_normal())
        counts.add(len(detector.process(SonarImage(float(k), distance, AZIMUTH, noise(rng)))))
    assert len(counts) > 1  # of a single image exactly the stated number is taken
