"""An independent implementation of image sources, image by image, in convex and other simple polygons."""

import numpy as np
import pyroomacoustics
import pytest
import shapely

from polymap_ros.geometry.image_sources import visible_images

THEIR_ERROR_M = 3e-6
"""They compute in single precision."""


def random_polygon(generator, n):
    """Corners on a stretched circle of 1 m, counter-clockwise."""
    gaps = generator.uniform(0.4, 1.0, n)
    angles = generator.uniform(0, 2 * np.pi) + 2 * np.pi * np.cumsum(gaps) / gaps.sum()
    return 0.5 * np.column_stack([np.cos(angles), generator.uniform(0.5, 1.0) * np.sin(angles)])


SHAPES = {
    'L': [(0.0, 0.0), (1.4, 0.0), (1.4, 0.5), (0.6, 0.5), (0.6, 1.2), (0.0, 1.2)],
    'T': [(0.5, 0.0), (1.0, 0.0), (1.0, 0.7), (1.5, 0.7), (1.5, 1.2), (0.0, 1.2), (0.0, 0.7), (0.5, 0.7)],
    'U': [(0.0, 0.0), (1.5, 0.0), (1.5, 1.1), (1.0, 1.1), (1.0, 0.4), (0.45, 0.4), (0.45, 1.2), (0.0, 1.2)],
    'dart': [(0.0, 0.0), (0.7, 0.35), (1.4, 0.05), (0.75, 1.2)],
    'dent': [(0.0, 0.0), (0.5, 0.25), (0.9, -0.1), (1.3, 0.5), (0.9, 1.1), (0.1, 0.9)],
    'skew': [(0.0, 0.0), (1.3, -0.1), (1.45, 0.55), (0.68, 0.52), (0.55, 1.25), (-0.1, 1.1)],
}
"""Right angles, shoulders on one line, and outlines without either; counter-clockwise."""


def assert_the_same_images(corners, position, receiver, order, nearest_m=np.inf):
    room = pyroomacoustics.Room.from_corners(corners.T, fs=16000, max_order=order)
    room.add_source(position)
    room.add_microphone(receiver)
    room.image_source_model()
    visible = room.visibility[0][0].astype(bool)
    theirs = room.sources[0].images[:, visible].T
    theirs = theirs[np.linalg.norm(theirs - position, axis=1) > 1e-6]  # without the source itself
    images = visible_images(corners, position, order, receiver=receiver)
    ours = images.position_m
    np.testing.assert_allclose(images.distance_m, np.linalg.norm(ours - receiver, axis=1))
    assert len(ours) == len(theirs)
    apart = np.linalg.norm(ours[:, None] - theirs[None], axis=2)
    assert np.all(apart.min(axis=1) < THEIR_ERROR_M)
    assert np.all(apart.min(axis=0) < THEIR_ERROR_M)


@pytest.mark.parametrize('apart_m', [0.0, 0.05])
@pytest.mark.parametrize('seed', range(12))
def test_images_are_those_of_pyroomacoustics(seed, apart_m):
    generator = np.random.default_rng(seed)
    n = 3 + seed % 6
    corners = random_polygon(generator, n)
    position = generator.dirichlet(np.full(n, 3.0)) @ corners
    angle = generator.uniform(0.0, 2.0 * np.pi)
    receiver = position + apart_m * np.array([np.cos(angle), np.sin(angle)])
    assert_the_same_images(corners, position, receiver, 3 if n > 6 else 5)


@pytest.mark.parametrize('shape', SHAPES)
@pytest.mark.parametrize('seed', range(4))
def test_images_in_outlines_that_are_not_convex_are_those_of_pyroomacoustics(shape, seed):
    """The receiver is aside, since a right angle sends a path back to its source through the corner itself."""
    corners, generator = np.array(SHAPES[shape]), np.random.default_rng(seed)
    polygon = shapely.Polygon(corners).buffer(-0.03)
    points = (generator.uniform(corners.min(axis=0), corners.max(axis=0)) for _ in range(1000))
    position, receiver = [point for point in points if polygon.contains(shapely.Point(point))][:2]
    assert_the_same_images(corners, position, receiver, 4)
