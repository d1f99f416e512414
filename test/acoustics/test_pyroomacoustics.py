"""An independent implementation of image sources, image by image on random convex polygons."""

import numpy as np
import pyroomacoustics
import pytest

from polymap_ros.acoustics.image_sources import visible_images

THEIR_ERROR_M = 3e-6
"""They compute in single precision."""


def random_polygon(generator, n):
    """Corners on a stretched circle of 1 m, counter-clockwise."""
    gaps = generator.uniform(0.4, 1.0, n)
    angles = generator.uniform(0, 2 * np.pi) + 2 * np.pi * np.cumsum(gaps) / gaps.sum()
    return 0.5 * np.column_stack([np.cos(angles), generator.uniform(0.5, 1.0) * np.sin(angles)])


@pytest.mark.parametrize('apart_m', [0.0, 0.05])
@pytest.mark.parametrize('seed', range(12))
def test_images_are_those_of_pyroomacoustics(seed, apart_m):
    generator = np.random.default_rng(seed)
    n = 3 + seed % 6
    corners = random_polygon(generator, n)
    position = generator.dirichlet(np.full(n, 3.0)) @ corners
    angle = generator.uniform(0.0, 2.0 * np.pi)
    receiver = position + apart_m * np.array([np.cos(angle), np.sin(angle)])
    order = 3 if n > 6 else 5
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
