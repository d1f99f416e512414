"""Eq. (4) against the sum written out, at any scale, and its growth."""

import numpy as np
import pytest

from polymap_ros.errors import ParameterError, StateError
from polymap_ros.map_parameters import GridParameters
from polymap_ros.maps.beamforming import BeamformingMap

GRIDS = {
    'plate': GridParameters(),
    'window': GridParameters(angle_min_deg=-30.0, angle_max_deg=75.0, range_max_m=1.0),
    'fine': GridParameters(range_max_m=0.09, range_step_m=5e-5, angle_min_deg=80.0, angle_max_deg=100.0,
                           angle_step_deg=0.02),
    'hall': GridParameters(range_max_m=100.0, range_step_m=0.5, angle_step_deg=7.0),
    'uneven': GridParameters(range_max_m=1.0, range_step_m=0.03, angle_step_deg=0.7),
}


def batch(beam_map, positions, envelopes):
    """Eq. (4) as it stands, over whole arrays, in float64."""
    x, y = np.asarray(positions, dtype=float).T
    p = np.outer(x, np.cos(beam_map.theta_rad)) + np.outer(y, np.sin(beam_map.theta_rad))
    total = np.zeros((len(beam_map.theta_rad), len(beam_map.r_m)))
    for shifts, envelope in zip(p, envelopes, strict=True):
        distance = np.abs(shifts[:, None] - beam_map.r_m)
        total += np.interp(distance, beam_map.r_m, envelope, right=0.0)
    return total


def draw(grid, count, seed=0):
    rng = np.random.default_rng(seed)
    n_r = len(BeamformingMap(grid).r_m)
    return rng.uniform(-1.2, 1.2, (count, 2)) * grid.range_max_m, rng.random((count, n_r)).astype(np.float32)


@pytest.mark.parametrize('name', GRIDS)
def test_equals_the_batch_sum_at_every_scale(name):
    positions, envelopes = draw(GRIDS[name], 70)
    beam_map = BeamformingMap(GRIDS[name])
    for (x, y), envelope in zip(positions, envelopes, strict=True):
        beam_map.add(x, y, envelope)
    expected = batch(beam_map, positions, envelopes)
    np.testing.assert_allclose(beam_map.values, expected, atol=1e-5 * expected.max(), rtol=0.0)
    assert beam_map.values.dtype == np.float32
    assert beam_map.count == 70


def test_equals_the_batch_sum_after_10000_pings():
    grid = GridParameters(range_max_m=1.0, range_step_m=0.05, angle_step_deg=10.0)
    positions, envelopes = draw(grid, 10_000)
    beam_map = BeamformingMap(grid)
    for (x, y), envelope in zip(0.4 * positions, envelopes, strict=True):
        beam_map.add(x, y, envelope)
    np.testing.assert_allclose(beam_map.values, batch(beam_map, 0.4 * positions, envelopes), rtol=1e-5)


@pytest.mark.parametrize('cells', [-41, -40, -39, -3, 0, 1, 39, 40, 41, 1e9, -1e300])
def test_whole_shifts_keep_both_ends_of_the_envelope_and_nothing_beyond(cells):
    beam_map = BeamformingMap(GridParameters(
        range_max_m=4.0, range_step_m=0.1, angle_min_deg=0.0, angle_max_deg=1.0))
    envelope = np.arange(1.0, 42.0, dtype=np.float32)
    beam_map.add(cells * 0.1, 0.0, envelope)
    distance = np.abs(np.arange(41) - cells)
    expected = np.where(distance < 40.5, distance + 1.0, 0.0)
    np.testing.assert_allclose(beam_map.values[0], expected, atol=1e-4)


def test_axes_are_multiples_of_the_steps():
    beam_map = BeamformingMap(GRIDS['plate'])
    assert beam_map.values.shape == (360, 601)
    assert beam_map.r_m[[0, 1, -1]] == pytest.approx([0.0, 0.005, 3.0])
    np.testing.assert_allclose(np.rad2deg(beam_map.theta_rad), np.arange(360))
    assert beam_map.full_circle
    window = BeamformingMap(GRIDS['window'])
    np.testing.assert_allclose(np.rad2deg(window.theta_rad), np.arange(-30, 75))
    assert not window.full_circle
    assert len(BeamformingMap(GRIDS['fine']).r_m) == 1801
    off = BeamformingMap(GridParameters(angle_min_deg=0.5, angle_max_deg=4.5, angle_step_deg=2.0))
    np.testing.assert_allclose(np.rad2deg(off.theta_rad), [2.0, 4.0])


def test_a_window_without_an_angle_is_refused():
    with pytest.raises(ParameterError, match='angle_step_deg'):
        BeamformingMap(GridParameters(angle_min_deg=91.0, angle_max_deg=92.0, angle_step_deg=60.0))


def test_a_wall_appears_at_its_line():
    beam_map = BeamformingMap(GRIDS['plate'])
    r, theta = 1.3, np.deg2rad(217.0)
    for x, y in np.random.default_rng(3).uniform(-0.5, 0.5, (30, 2)):
        distance = abs(x * np.cos(theta) + y * np.sin(theta) - r)
        beam_map.add(x, y, np.exp(-((beam_map.r_m - distance) / 0.01) ** 2).astype(np.float32))
    row, column = np.unravel_index(beam_map.values.argmax(), beam_map.values.shape)
    assert (beam_map.r_m[column], np.rad2deg(beam_map.theta_rad[row])) == pytest.approx((1.3, 217.0))
    assert beam_map.normalised().max() == 1.0


def test_an_empty_map_is_zero_not_nan():
    assert not np.any(BeamformingMap(GRIDS['window']).normalised())


def test_values_are_a_copy():
    beam_map = BeamformingMap(GRIDS['window'])
    beam_map.add(0.0, 0.0, np.ones(len(beam_map.r_m), np.float32))
    before = beam_map.values
    beam_map.add(0.0, 0.0, np.ones(len(beam_map.r_m), np.float32))
    assert before.max() == pytest.approx(1.0)


@pytest.mark.parametrize('cut', [1, 63, 64, 100])
def test_a_restored_map_goes_on_bit_by_bit(cut):
    positions, envelopes = draw(GRIDS['window'], 150)
    whole, first, second = (BeamformingMap(GRIDS['window']) for _ in range(3))
    for i, ((x, y), envelope) in enumerate(zip(positions, envelopes, strict=True)):
        whole.add(x, y, envelope)
        if i == cut:
            second.restore(first.state())
        (first if i < cut else second).add(x, y, envelope)
    assert second.values.tobytes() == whole.values.tobytes()
    assert second.count == 150


def test_a_map_of_another_grid_or_with_nan_is_refused():
    state = BeamformingMap(GRIDS['window']).state()
    with pytest.raises(StateError, match='cells'):
        BeamformingMap(GRIDS['plate']).restore(state)
    state['total'][3, 4] = np.nan
    with pytest.raises(StateError, match='finite'):
        BeamformingMap(GRIDS['window']).restore(state)
