"""A_T: the union of discs."""

import numpy as np
import pytest
import shapely
from references import shapely_iou

from polymap_ros.errors import StateError
from polymap_ros.maps.free_area import FreeArea


def fill(discs, area=None):
    area = area or FreeArea()
    for disc in discs:
        area.add(*disc)
    return area


def draw(count, seed=0):
    rng = np.random.default_rng(seed)
    return np.column_stack((rng.uniform(-1.0, 1.0, (count, 2)), rng.uniform(0.02, 0.4, count))).tolist()


@pytest.mark.parametrize('scale', [1e-3, 1.0, 100.0])
@pytest.mark.parametrize('count', [1, 2, 60, 300])
def test_is_the_union_of_discs_at_every_scale(count, scale):
    discs = scale * np.array(draw(count))
    area = fill(discs.tolist())
    round_discs = shapely.buffer(shapely.points(discs[:, :2]), discs[:, 2], quad_segs=160)
    expected = shapely.union_all(round_discs)
    assert area.area == pytest.approx(expected.area, rel=2e-3)
    assert expected.buffer(1e-9 * scale).covers(area.shape)  # no point is claimed free that is not
    assert area.shape.is_valid


def test_two_discs_apart_are_two_parts_and_a_ring_of_discs_has_a_hole():
    assert len(shapely.get_parts(fill([(0.0, 0.0, 1.0), (5.0, 0.0, 1.0)]).shape)) == 2
    ring = fill([(np.cos(a), np.sin(a), 0.3) for a in np.linspace(0.0, 2 * np.pi, 40)])
    assert shapely.get_num_interior_rings(ring.shape) == 1
    square = np.array([(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)])
    assert ring.iou(square) == pytest.approx(shapely_iou(ring.shape, shapely.Polygon(square)), abs=1e-12)


@pytest.mark.parametrize('rho', [np.nan, 0.0, -1.0])
def test_a_ping_without_a_range_adds_nothing(rho):
    area = fill([(0.0, 0.0, 1.0), (9.0, 0.0, rho)])
    assert area.area == fill([(0.0, 0.0, 1.0)]).area


def test_an_empty_area_overlaps_with_nothing():
    assert FreeArea().area == 0.0
    assert FreeArea().iou([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]) == 0.0


def test_looking_at_it_changes_nothing():
    discs = draw(200)
    watched = FreeArea()
    for disc in discs:
        watched.add(*disc)
        assert watched.area > 0.0
    assert shapely.to_wkb(watched.shape) == shapely.to_wkb(fill(discs).shape)


def test_a_region_taken_does_not_change():
    area = fill(draw(5))
    region, before = area.region, area.area
    area.add(10.0, 0.0, 1.0)
    assert region.area == before < area.area


def test_corners_do_not_pile_up():
    angles = 2 * np.pi * np.arange(5000) / 500
    noise = np.random.default_rng(1).normal(scale=1e-3, size=(3, 5000))
    area = fill(np.column_stack((np.cos(angles), np.sin(angles), np.full(5000, 0.3))) + noise.T)
    assert shapely.get_num_coordinates(area.shape) < 3000


@pytest.mark.parametrize('cut', [0, 30, 64, 130])
def test_a_restored_area_goes_on_bit_by_bit(cut):
    discs, second = draw(150), FreeArea()
    second.restore(fill(discs[:cut]).state())
    fill(discs[cut:], second)
    assert shapely.to_wkb(second.shape) == shapely.to_wkb(fill(discs).shape)


@pytest.mark.parametrize('change', [
    {'united': np.array([1, 2, 3], np.uint8)},
    {'united': np.array([1, 8, 0, 0, 0, 0, 0, 0, 0], np.uint8)},  # arcs: none
    {'united': np.frombuffer(shapely.to_wkb(shapely.Point(0, 0)), np.uint8)},
    {'united': np.frombuffer(shapely.to_wkb(shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])), np.uint8)},
    {'discs': np.zeros((2, 2))}, {'discs': np.full((1, 3), np.inf)},
])
def test_a_damaged_area_is_refused(change):
    with pytest.raises(StateError):
        FreeArea().restore({**fill(draw(3)).state(), **change})
