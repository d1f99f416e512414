"""Images among any walls: against the exact convex search, an independent library, and by hand."""

import numpy as np
import pyroomacoustics
import pytest
import shapely

from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.simulation.random_scenes import Recipe, random_scene
from polymap_ros.simulation.reflectors import Reflectors, heard_images
from polymap_ros.simulation.shaped_scenes import SHAPE_KINDS

L_SHAPE = np.array([[0.0, 0.0], [1.6, 0.0], [1.6, 0.7], [0.8, 0.7], [0.8, 1.3], [0.0, 1.3]])
T_SHAPE = np.array([[0.6, 0.0], [1.0, 0.0], [1.0, 0.8], [1.6, 0.8], [1.6, 1.4], [0.0, 1.4], [0.0, 0.8], [0.6, 0.8]])
OBLIQUE = np.array([[0.0, 0.0], [1.5, -0.2], [1.7, 0.8], [0.9, 0.6], [0.7, 1.4], [-0.2, 1.1]])


def same_points(ours, theirs, tolerance_m):
    assert len(ours) == len(theirs)
    apart = np.linalg.norm(ours[:, None] - theirs[None], axis=2)
    assert apart.min(axis=1).max() < tolerance_m
    assert apart.min(axis=0).max() < tolerance_m


@pytest.mark.parametrize('shape', ['convex', 'right_angled', 'regular'])
@pytest.mark.parametrize('edges', [3, 4, 6])
def test_in_a_convex_room_the_images_are_those_of_the_beam_search(shape, edges):
    scene = random_scene(8, edges, Recipe(shape))
    reflection = np.random.default_rng(edges).uniform(-1.0, 1.0, edges)
    walls = Reflectors.outline(scene.vertices, reflection)
    for position in scene.positions[::20]:
        expected = visible_images(scene.vertices, position, 3, reflection)
        found, amplitude = heard_images(walls, position, 3)
        same_points(found, expected.position_m, 1e-9)
        np.testing.assert_allclose(np.linalg.norm(found - position, axis=1), expected.distance_m, atol=1e-9)
        np.testing.assert_allclose(np.sort(amplitude), np.sort(expected.amplitude), atol=1e-12)


@pytest.mark.parametrize('corners', [L_SHAPE, T_SHAPE, OBLIQUE], ids=['L', 'T', 'oblique'])
@pytest.mark.parametrize('seed', range(4))
def test_behind_a_corner_the_images_are_those_of_pyroomacoustics(corners, seed):
    """In single precision; with the receiver at the source they would list some corners' images twice."""
    generator = np.random.default_rng(seed)
    room = pyroomacoustics.Room.from_corners(corners.T, fs=16000, max_order=3)
    while True:
        position = generator.uniform(corners.min(axis=0), corners.max(axis=0))
        if room.is_inside(position):
            break
    room.add_source(position)
    room.add_microphone(position + 1e-3 * np.array((np.cos(1.2345), np.sin(1.2345))))
    room.image_source_model()
    theirs = room.sources[0].images[:, room.visibility[0][0].astype(bool)].T
    theirs = np.unique(theirs[np.linalg.norm(theirs - position, axis=1) > 1e-5].round(4), axis=0)
    same_points(heard_images(Reflectors.outline(corners), position, 3)[0], theirs, 2e-4)


def test_the_notch_of_an_l_hides_what_is_behind_it():
    position = np.array([1.4, 0.2])  # in the foot of the L, which does not see the top of its upright
    images, _ = heard_images(Reflectors.outline(L_SHAPE), position, 1)
    feet = 0.5 * (images + position)
    np.testing.assert_allclose(sorted(feet.tolist()), [[0.0, 0.2], [1.4, 0.0], [1.4, 0.7], [1.6, 0.2]], atol=1e-12)


def test_a_seam_returns_a_part_and_lets_the_rest_through():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    walls = Reflectors.outline(square).with_seam([0.6, 0.0], [0.6, 1.0], 0.6)
    position = np.array([0.25, 0.5])
    images, amplitude = heard_images(walls, position, 1)
    found = {tuple(np.round(image, 9)): strength for image, strength in zip(images, amplitude, strict=True)}
    assert found == {
        (-0.25, 0.5): 1.0, (0.25, -0.5): 1.0, (0.25, 1.5): 1.0, (0.95, 0.5): 0.6,
        (1.75, 0.5): pytest.approx(0.8**2),  # there and back through the seam
    }


def test_a_short_seam_is_heard_beside_it_only():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    walls = Reflectors.outline(square).with_seam([0.6, 0.2], [0.6, 0.4], 0.5)
    for y, count in ((0.3, 5), (0.5, 4), (0.1, 4)):
        assert len(heard_images(walls, [0.25, y], 1)[0]) == count


@pytest.mark.parametrize('kind', ['l', 't', 'u', 'z'])
def test_a_right_angle_sends_its_echo_back_whatever_rounding_makes_of_the_corner(kind):
    """The path over both walls of a corner goes through the corner itself; it is there once, from every place."""
    corners = SHAPE_KINDS[kind].corners(np.random.default_rng(4))
    walls, inside = Reflectors.outline(corners, 1.0), shapely.Polygon(corners).buffer(-0.03)
    drawn = np.random.default_rng(5).uniform(corners.min(axis=0), corners.max(axis=0), (150, 2))
    places = [place for place in drawn if inside.contains(shapely.Point(place))]
    assert len(places) > 60
    for place in places:
        found, (expected, amplitude) = visible_images(corners, place, 3), heard_images(walls, place, 3)
        assert np.sum(found.amplitude) == pytest.approx(np.sum(amplitude))
        apart = np.linalg.norm(expected[:, None] - found.position_m[None], axis=2)
        assert np.all(apart.min(axis=1) < 1e-6)
