"""Plates with holes and inner walls have what they promise."""

import numpy as np
import pytest
import shapely

from polymap_ros.simulation.inside import Hole
from polymap_ros.simulation.shaped_scenes import SHAPE_KINDS, clean_echoes, shaped_scene
from polymap_ros.simulation.waveforms import noise_free

KINDS = [name for name, kind in SHAPE_KINDS.items() if kind.inside]


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('name', KINDS)
def test_every_wall_is_heard_directly_by_six_pings(name, seed):
    scene = shaped_scene(name, seed)
    assert 60 <= len(scene.poses) <= 100
    holes = [hole.vertices for hole in scene.holes]
    straight = [hole.vertices for hole in scene.holes if isinstance(hole, Hole)]
    room, counts = shapely.Polygon(scene.vertices, holes), []
    for x, y, radius, _ in scene.circles:
        away = scene.positions - (x, y)
        feet = (x, y) + 1.01 * radius * away / np.linalg.norm(away, axis=1)[:, None]
        seen = np.array([room.covers(shapely.LineString(ends)) for ends in zip(scene.positions, feet, strict=True)])
        east, north = away[seen].T
        counts += [np.sum(one > np.abs(other)) for one, other in (
            (east, north), (-east, north), (north, east), (-north, east))]  # of a round hole each quarter
    rings = [(ring[k - 1], ring[k], False) for ring in (scene.vertices, *straight) for k in range(len(ring))]
    for a, b, both_sides in [*rings, *((wall.start, wall.end, True) for wall in scene.inner_walls)]:
        length = np.linalg.norm(b - a)
        heard = 0
        for place in scene.positions:
            share = (place - a) @ (b - a) / length**2
            foot = a + share * (b - a)
            in_front = (b - a)[0] * (place - a)[1] - (b - a)[1] * (place - a)[0] > 0.0
            way = shapely.LineString((place, foot - 1e-6 * (foot - place)))
            heard += 0.0 <= share <= 1.0 and (both_sides or in_front) and room.covers(way)
        counts.append(heard)
    assert min(counts) >= 6
    way = shapely.LineString(scene.positions)
    assert all(way.distance(shapely.Polygon(hole)) > 0.05 for hole in holes)
    assert way.distance(shapely.LinearRing(scene.vertices)) > 0.05


@pytest.mark.parametrize('seed', range(4))
def test_holes_are_rectangles_or_round_and_inner_walls_as_long_as_said(seed):
    for name, count in (('hole', 1), ('two_holes', 2)):
        scene = shaped_scene(name, seed)
        assert len(scene.holes) == count
        assert 3 <= len(scene.vertices) <= 6
        for hole in scene.holes:
            along = np.roll(hole.vertices, -1, axis=0) - hole.vertices
            lengths = np.linalg.norm(along, axis=1)
            assert len(lengths) == 4
            assert lengths.min() >= 0.15 - 1e-9
            assert lengths.max() <= 0.4 + 1e-9
            np.testing.assert_allclose(np.einsum('ij,ij->i', along, np.roll(along, 1, axis=0)), 0.0, atol=1e-9)
    for name, count in (('round_hole', 1), ('two_round_holes', 2)):
        circles = shaped_scene(name, seed).circles
        assert len(circles) == count
        assert ((circles[:, 2] >= 0.075) & (circles[:, 2] <= 0.2)).all()
    for name, low, high in (('stiffener', 0.5, 0.8), ('seam', 1.0, 1.0)):
        scene = shaped_scene(name, seed)
        wall, = scene.inner_walls
        along = wall.end - wall.start
        chord = shapely.LineString((wall.start - 9 * along, wall.end + 9 * along)).intersection(
            shapely.Polygon(scene.vertices))
        assert low - 1e-9 <= np.hypot(*along) / chord.length <= high + 1e-9
        assert 0.2 <= wall.reflection <= 0.6
        assert wall.transmission == pytest.approx(np.sqrt(1.0 - wall.reflection**2))
        ends, outline = shapely.points((wall.start, wall.end)), shapely.LinearRing(scene.vertices)
        assert (shapely.distance(ends, outline) > 1e-3).tolist() == [name == 'stiffener'] * 2


def test_the_same_seed_gives_the_same_scene_and_another_one_another():
    first, again, other = (shaped_scene('hole', seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.poses, again.poses)
    np.testing.assert_array_equal(first.holes[0].vertices, again.holes[0].vertices)
    assert not np.allclose(first.poses, other.poses)


def test_echoes_of_a_scene_are_those_of_all_of_its_walls():
    scene = shaped_scene('seam', 1)
    np.testing.assert_array_equal(clean_echoes(scene), noise_free(scene))
