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
"""The grid of the fixed frame: axes of images, places from poses, and a grid that follows."""

import numpy as np
import pytest

from tsepm_ros.detector.fixed_frame import FixedGrid, ImageAxis, PosedCells, median, shifted

AXES = {
    "even": np.linspace(1.0, 40.0, 60),
    "descending": np.linspace(0.7, -0.7, 33),
    "finer to one side": np.cumsum(np.linspace(0.01, 0.05, 50)),
    "one": np.array([0.3]),
}
AZIMUTH, RANGE = np.linspace(0.9, -0.9, 64), np.linspace(1.0, 30.0, 90)


@pytest.mark.parametrize("name", AXES)
def test_the_nearest_cell_of_an_axis_and_numbers_of_values_are_right(name):
    centres, rng = AXES[name], np.random.default_rng(1)
    axis, number = ImageAxis(centres), rng.uniform(-0.49, len(centres) - 0.51, 500)
    value = axis.values(number)
    np.testing.assert_allclose(axis.numbers(value), number, atol=1e-9)
    apart = np.abs(centres - value[:, None])
    step = np.abs(np.diff(centres)).min() if len(centres) > 1 else 1.0
    assert (apart[np.arange(500), axis.nearest(value)] <= apart.min(axis=1) + 0.2 * step).all()
    beyond = np.array([centres.min() - 2.0 * np.ptp(centres) - 2.0, centres.max() + 99.0])
    assert (axis.nearest(beyond) == -1).all() and np.isinf(axis.numbers(beyond)).all()


def poses(x=0.0, y=0.0, yaw=0.0, sweep=0.0):
    """Poses of bearings between which the sensor moves so far along x, m."""
    along = x + sweep * np.linspace(0.0, 1.0, len(AZIMUTH))
    return np.stack([along, np.full_like(along, y), yaw + 0.1 * (along - x)], axis=1)


@pytest.mark.parametrize("sweep", [0.0, 1.0])
def test_places_of_cells_lead_back_to_the_cells_by_the_poses_of_their_bearings(sweep):
    grid, rng = FixedGrid(AZIMUTH, RANGE), np.random.default_rng(2)
    grid.look(poses(500.0, -80.0, 3.0, sweep))
    cell = np.stack([rng.uniform(2, 61, 300), rng.uniform(30, 88, 300)], axis=1)
    place = grid.places(cell)
    assert np.abs(grid.cells(place) - cell).max() < (1e-6 if not sweep else 0.5)
    ahead = poses(500.0, -80.0, 3.0, sweep)[32]
    straight = ahead[:2] + 20.0 * np.array([np.cos(ahead[2]), np.sin(ahead[2])])
    assert np.linalg.norm(grid.places(np.array([[31.5, 58.31]]))[0] - straight) < 0.1 + sweep
    assert np.isinf(grid.cells(np.array([[500.0, 900.0]]))).any()


def test_what_a_sensor_sees_of_the_ground_stays_in_its_place_while_it_drives_and_turns():
    """The ground is a plane wave of 12 m, so that interpolation has no part in it."""
    grid = FixedGrid(AZIMUTH, RANGE)
    state, origin = np.zeros(grid.shape, np.float32), grid.origin
    errors = []
    for k in range(60):
        grid.look(poses(1.5 * k, 3.0, 0.02 * k, sweep=0.3))
        state, origin = shifted(state, grid.origin - origin, 9.0), grid.origin
        cells = np.stack(np.meshgrid(np.arange(64.0), np.arange(90.0), indexing="ij"), axis=-1)
        place = grid.places(cells.reshape(-1, 2)).reshape(64, 90, 2)
        image = np.sin(place @ np.array([0.5, 0.2])).astype(np.float32)
        if k >= 30:
            seen = grid.at_cells(state)[8:-8, 4:50]
            errors.append(np.abs(seen - image[8:-8, 4:50])[np.abs(seen) < 2.0].max())
        box, x, _, there = grid.sampled(1 + k // 30, k, image, image, np.ones(image.shape, bool))
        state[box][there] = x[there]
    assert max(errors) < 0.5, "of an amplitude of 1"
    assert np.median(errors) < 0.3


def test_an_empty_image_over_an_empty_ground_shows_no_error_of_the_pose():
    grid, nothing = FixedGrid(AZIMUTH, RANGE), np.zeros((64, 90), np.float32)
    grid.look(poses())
    ground = np.zeros(grid.shape, np.float32)
    assert not grid.displaced(ground, nothing, poses(), np.zeros(3)).any()


@pytest.mark.parametrize(("error", "sees"), [((0.5, -0.4, 0.03), 1.0), ((0.5, -0.4, 0.03), 0.0)])
def test_the_error_of_a_pose_is_found_where_there_is_a_ground_to_see(error, sees):
    """The ground is a sum of plane waves in noise; without a ground the error counts as none."""
    rng, grid = np.random.default_rng(5), FixedGrid(AZIMUTH, RANGE)
    waves = rng.normal(0.0, 0.6, (40, 2)), rng.uniform(0.0, 6.0, 40)
    state, before, errors = np.zeros(grid.shape, np.float32), np.zeros(3), []
    cells = np.stack(np.meshgrid(np.arange(64.0), np.arange(90.0), indexing="ij"), axis=-1)
    for k in range(12):
        grid.look(poses(0.3 * k, 3.0, 0.02 * k))
        if not k:
            side = (np.arange(grid.shape[0]) + grid.origin[:, None]) * grid._cell
            place = np.stack(np.meshgrid(*side, indexing="ij"), axis=-1)
            state += sees * np.cos(place @ waves[0].T + waves[1]).sum(axis=-1)
            first = grid.origin
        place = grid.places(cells.reshape(-1, 2))
        image = sees * np.cos(place @ waves[0].T + waves[1]).sum(axis=-1).reshape(64, 90)
        image = (image + rng.normal(0.0, 3.0, image.shape)).astype(np.float32)
        mean = shifted(state, grid.origin - first)
        before = grid.displaced(mean, image, poses(0.3 * k, 3.0, 0.02 * k) + error, before)
        errors.append(before + (np.array(error) if sees else 0.0))
    assert np.abs(np.median(errors, axis=0)).max() < 0.05


def test_the_grid_follows_a_sensor_that_has_gone_half_of_its_margin_and_stays_until_then():
    grid = FixedGrid(AZIMUTH, RANGE)
    origins = []
    for x in (0.0, 3.5, -3.5, 4.0):  # the margin is a fourth of 30 m
        grid.look(poses(x))
        origins.append(grid.origin[0] * grid._cell)
    assert origins[0] == origins[1] == origins[2]
    assert origins[3] - origins[0] == pytest.approx(4.0, abs=grid._cell)


def test_the_grid_is_bounded_and_forgets_what_it_leaves():
    grid = FixedGrid(AZIMUTH, RANGE)
    assert np.prod(grid.shape) < 10 * len(AZIMUTH) * len(RANGE)
    grid.look(poses())
    state, origin = np.ones(grid.shape, np.float32), grid.origin
    grid.look(poses(1e5))
    assert (shifted(state, grid.origin - origin, 0.5) == 0.5).all()
    far = FixedGrid(np.linspace(-3.1, 3.1, 3), np.linspace(1e3, 1e5, 5000))
    far.look(np.zeros((3, 3)))
    assert max(far.shape) <= 2002


@pytest.mark.parametrize("cells", [0.0, 1.0])
def test_every_row_of_the_ground_is_looked_at_whatever_the_speed(cells):
    grid, rows, image = FixedGrid(AZIMUTH, RANGE), [], np.zeros((64, 90), np.float32)
    for turn in range(80):
        grid.look(poses(turn * cells * grid._cell))
        (part, _), *_ = grid.sampled(2, turn, image, image, image == 0.0)
        rows += (np.arange(part.start, part.stop, part.step) + grid.origin[0]).tolist()
    odd = np.mean(np.array(rows) % 2)
    assert 0.4 < odd < 0.6


def test_the_cells_of_images_are_those_of_the_grid_where_the_pose_stays():
    """All are looked at, half of them in each image."""
    cells, image = PosedCells(AZIMUTH, RANGE), np.arange(64.0 * 90.0).reshape(64, 90)
    state = np.zeros(cells.shape)
    for turn in range(2):
        rows, x, z, there = cells.sampled(2, turn, image, -image, image >= 0.0)
        assert there.all() and there.size == state.size / 2
        state[rows] = x - z
    assert (cells.at_cells(state) == 2.0 * image).all()


@pytest.mark.parametrize("number", [1, 2, 7, 90])
def test_the_median_is_that_of_numpy(number):
    values = np.random.default_rng(3).normal(size=number)
    assert median(values) == np.median(values)
