"""Images in floor and ceiling, against reflections one by one and against pyroomacoustics in three dimensions."""

import numpy as np
import pyroomacoustics
import pytest

from polymap_ros.geometry.path_room import CAPACITY, room_for_paths
from polymap_ros.geometry.paths import trace_paths
from polymap_ros.geometry.sides import outline_sides
from polymap_ros.geometry.storey import Storey

FLOOR_M, CEILING_M = 0.3, 2.1


def storey(floor=0.8, ceiling=-0.6):
    return Storey(np.array([FLOOR_M, CEILING_M]), np.array([floor, ceiling]))


def test_each_image_is_the_one_before_it_mirrored():
    """By both planes in turn, begun with either: reflected twice in a row by one plane, an image is itself."""
    rows = storey().images(5, level=False)
    expected = [(0.0, 1.0, 0)]
    for first in (0, 1):
        z, strength = 0.0, 1.0
        for bounces in range(1, 6):
            below = (first + bounces) % 2 == 1
            z = -FLOOR_M - (z + FLOOR_M) if below else CEILING_M + (CEILING_M - z)
            strength *= 0.8 if below else -0.6
            expected.append((z, strength, bounces))
    np.testing.assert_allclose(sorted(rows.tolist()), sorted(expected))


def test_as_far_above_as_below_is_one_path_between_ends_at_one_height():
    apart, level = (storey().images(4, level=level) for level in (False, True))
    assert len(apart) == 9
    assert len(level) == 7  # by two and by four reflections there is one of each way
    assert np.sum(np.abs(apart[:, 1])) == pytest.approx(np.sum(np.abs(level[:, 1])))


def test_one_plane_alone_reflects_once():
    np.testing.assert_allclose(Storey(np.array([0.5]), np.array([0.9])).images(5), [(0.0, 1.0, 0), (-1.0, 0.9, 1)])
    np.testing.assert_allclose(Storey().images(5), [(0.0, 1.0, 0)])


@pytest.mark.parametrize(('apart', 'up'), [((0.0, 0.0), 0.0), ((0.05, -0.02), 0.0), ((0.03, 0.04), 0.1)])
def test_paths_are_those_of_pyroomacoustics_in_three_dimensions(apart, up):
    size, place, order = np.array([3.1, 2.3, FLOOR_M + CEILING_M]), np.array([1.17, 0.81]), 4
    room = pyroomacoustics.ShoeBox(size, fs=16000, max_order=order)
    emitter, receiver = np.append(place, FLOOR_M), np.append(place + apart, FLOOR_M + up)
    room.add_source(emitter)
    room.add_microphone(receiver)
    room.image_source_model()
    theirs = np.linalg.norm(room.sources[0].images.T - receiver, axis=1)
    theirs = np.sort(theirs[np.linalg.norm(room.sources[0].images.T - emitter, axis=1) > 1e-6])
    corners = np.array([(0.0, 0.0), (size[0], 0.0), tuple(size[:2]), (0.0, size[1])])
    paths = room_for_paths(order)
    images = Storey(np.array([FLOOR_M, CEILING_M]), np.ones(2)).images(order, level=False)
    count = trace_paths(outline_sides(corners, 1e-9, True), np.array([*emitter[:2], *receiver[:2], up]), order, 100.0,
                        1e-9, False, images, paths)
    assert count < CAPACITY
    # Of the two ways through a corner of the rectangle each counts as a half where they are one.
    whole = np.repeat(2.0 * paths.half[:count], np.rint(2.0 * paths.weight[:count]).astype(int))
    twice = np.sort(np.repeat(theirs, 2))
    np.testing.assert_allclose(np.sort(whole), twice, atol=3e-6)


@pytest.mark.parametrize('up', [0.0, 0.15])
def test_derivatives_are_differences(up):
    """By emitter and receiver, and by the walls' r, of paths that the planes make of flat ones and of none."""
    corners, order, step = np.array([(0.0, 0.0), (2.0, -0.2), (2.3, 1.6), (0.1, 1.2)]), 3, 1e-6
    images, here = storey().images(order, level=False), np.array([0.9, 0.5, 0.96, 0.47, up])

    def traced(ends):
        paths = room_for_paths(order)
        count = trace_paths(outline_sides(corners, 1e-3, True), ends, order, 50.0, 1e-3, True, images, paths)
        keys = [(*paths.walls[m].tolist(), round(float(paths.weight[m]), 3)) for m in range(count)]
        return {(key, keys[:m].count(key)): (paths.half[m], paths.moves[m].copy()) for m, key in enumerate(keys)}

    at_once = traced(here)
    assert sum(all(wall < 0 for wall in key[0][:-1]) for key in at_once) == 6
    for axis in range(4):
        before, after = (traced(here + side * step * np.eye(5)[axis]) for side in (-1.0, 1.0))
        for key, (_, moves) in at_once.items():
            if key in before and key in after:
                difference = (after[key][0] - before[key][0]) / (2.0 * step)
                assert moves[axis] == pytest.approx(difference, abs=1e-6)
