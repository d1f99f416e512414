"""Visible images: counts computed elsewhere, corners by hand, and a brute force over all wall sequences."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polymap_ros.geometry.image_sources import visible_images

TRIANGLE = np.array([(0, 0), (1.2, 0), (0.4, 0.9)])
PENTAGON = np.array([(0, 0), (1, 0), (1.3, 0.7), (0.6, 1.2), (-0.2, 0.6)])
OFF_CENTRE = np.array([0.03, -0.05])


def mirrored(point, a, b):
    """The point mirrored in the line through a and b."""
    along = (b - a) / np.linalg.norm(b - a)
    foot = a + (point - a) @ along * along
    return 2 * foot - point


def crossing(p, q, a, b):
    """Where the line from p to q crosses the line from a to b: fractions (of pq, of ab)."""
    return np.linalg.solve(np.column_stack([q - p, a - b]), a - p)


def brute_force(corners, position, order, margin=1e-7):
    """All wall sequences, each image by mirroring, each path traced back wall by wall.

    Returns {walls: image} of the visible ones, and whether some path passes within `margin` of a corner, where
    visibility is a matter of rounding.
    """
    walls = [(corners[i], corners[(i + 1) % len(corners)]) for i in range(len(corners))]
    images, close = {}, False
    for n in range(1, order + 1):
        for sequence in itertools.product(range(len(walls)), repeat=n):
            if any(i == j for i, j in itertools.pairwise(sequence)):
                continue
            chain = [np.asarray(position, dtype=float)]
            for i in sequence:
                chain.append(mirrored(chain[-1], *walls[i]))
            at, seen = np.asarray(position, dtype=float), True
            for i, image in zip(reversed(sequence), reversed(chain[1:]), strict=True):
                try:
                    along, across = crossing(at, image, *walls[i])
                except np.linalg.LinAlgError:
                    seen = False
                    break
                if along <= 1e-12 or along > 1 or across < -margin or across > 1 + margin:
                    seen = False
                    break
                close |= min(abs(across), abs(1 - across)) < margin
                at = at + along * (image - at)
            if seen:
                images[sequence] = chain[-1]
    return images, close


def as_dictionary(images):
    return {
        tuple(row[:n].tolist()): tuple(place)
        for row, n, place in zip(images.walls, images.order, images.position_m, strict=True)
    }


@pytest.mark.parametrize(('corners', 'counts'), [(TRIANGLE, (3, 9, 18, 46)), (PENTAGON, (5, 15, 33, 81))])
def test_counts_computed_independently(corners, counts):
    position = corners.mean(axis=0) + OFF_CENTRE
    found = tuple(len(visible_images(corners, position, order).distance_m) for order in (1, 2, 3, 5))
    assert found == counts


@pytest.mark.parametrize(('corners', 'order'), [(TRIANGLE, 6), (PENTAGON, 4)])
def test_brute_force_agrees(corners, order):
    position = corners.mean(axis=0) + OFF_CENTRE
    expected, close = brute_force(corners, position, order)
    assert not close
    found = visible_images(corners, position, order)
    places = as_dictionary(found)
    assert set(places) == set(expected)
    for walls, place in places.items():
        assert place == pytest.approx(expected[walls], abs=1e-12)
    assert found.distance_m == pytest.approx(np.linalg.norm(found.position_m - position, axis=1))
    assert np.all(np.diff(found.distance_m) >= 0)


@st.composite
def rooms(draw):
    """Convex polygons with corners on a stretched circle, and a position inside."""
    n = draw(st.integers(3, 6))
    gaps = np.array(draw(st.lists(st.floats(0.3, 1.0), min_size=n, max_size=n)))
    angles = draw(st.floats(0, 6)) + 2 * np.pi * np.cumsum(gaps) / gaps.sum()
    corners = np.column_stack([np.cos(angles), draw(st.floats(0.4, 1.0)) * np.sin(angles)])
    weights = np.array(draw(st.lists(st.floats(0.1, 1.0), min_size=n, max_size=n)))
    return corners, weights @ corners / weights.sum()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(rooms(), st.integers(1, 3))
def test_brute_force_agrees_in_drawn_rooms(room, order):
    corners, position = room
    expected, close = brute_force(corners, position, order)
    if close:  # within 1e-7 of a corner: rounding decides
        return
    assert set(as_dictionary(visible_images(corners, position, order))) == set(expected)


@pytest.mark.parametrize('degrees', [40, 60, 75, 89.9])
def test_sharp_corner_is_heard_twice_at_equal_distance(degrees):
    images, distance = corner_images(degrees)
    assert images.distance_m == pytest.approx([distance, distance])
    assert {tuple(row) for row in images.walls.tolist()} == {(0, 1), (1, 0)}


def test_right_corner_is_heard_once():
    images, distance = corner_images(90)
    assert images.distance_m == pytest.approx([distance])
    assert images.amplitude == [0.8 * -0.5]


@pytest.mark.parametrize('degrees', [90.1, 100, 140])
def test_wide_corner_is_not_heard(degrees):
    images, _ = corner_images(degrees)
    assert len(images.distance_m) == 0


def corner_images(degrees):
    """Second-order images of the two walls of the corner at the origin, and the distance 2 R sin(a) of physics."""
    a = np.radians(degrees)
    corners = np.array([(3 * np.cos(a), 3 * np.sin(a)), (0, 0), (3, 0)])
    position = 0.5 * np.array([np.cos(0.45 * a), np.sin(0.45 * a)])
    images = visible_images(corners, position, 2, np.array([0.8, -0.5, 1.0]))
    corner = [n for n in range(len(images.order)) if images.order[n] == 2 and 2 not in images.walls[n]]
    return type(images)(*(column[corner] for column in images)), 2 * 0.5 * np.sin(a)


@pytest.mark.parametrize('order', [1, 2, 3, 4, 5])
@pytest.mark.parametrize('position', [(0.31, 0.22), (0.5, 0.35), (0.1, 0.1)])
def test_rectangle_has_the_images_of_a_lattice(position, order):
    """A W x H room: one image per (m, n) at x -> 2 m' W +- x, with |m| + |n| reflections, corners included."""
    width, height = 1.0, 0.7
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)])
    reflection = np.array([0.9, -0.8, 0.7, -0.6])  # bottom, right, top, left

    def unfolded(m, x, size):
        return m * size + (x if m % 2 == 0 else size - x)

    expected = []
    for m in range(-order, order + 1):
        for n in range(-order, order + 1):
            if not 1 <= abs(m) + abs(n) <= order:
                continue
            d = np.hypot(unfolded(m, position[0], width) - position[0], unfolded(n, position[1], height) - position[1])
            right, left = sorted([abs(m) // 2, (abs(m) + 1) // 2], reverse=m > 0)
            top, bottom = sorted([abs(n) // 2, (abs(n) + 1) // 2], reverse=n > 0)
            powers = np.array([bottom, right, top, left])
            expected.append((d, abs(m) + abs(n), np.prod(reflection**powers)))
    images = visible_images(corners, position, order, reflection)
    found = sorted(zip(images.distance_m.round(9), images.order, images.amplitude.round(9), strict=True))
    wanted = sorted((round(d, 9), n, round(a, 9)) for d, n, a in expected)
    assert np.array(found) == pytest.approx(np.array(wanted), abs=2e-9)


def test_amplitude_is_the_product_of_signed_reflections():
    reflection = np.array([1.0, -0.7, 0.5, -1.0, 0.3])
    images = visible_images(PENTAGON, PENTAGON.mean(axis=0) + OFF_CENTRE, 5, reflection)
    for walls, order, amplitude in zip(images.walls, images.order, images.amplitude, strict=True):
        assert np.all(walls[:order] >= 0)
        assert np.all(walls[order:] == -1)
        assert amplitude == pytest.approx(np.prod([reflection[wall] for wall in walls[:order]]))
    assert np.all(visible_images(PENTAGON, PENTAGON.mean(axis=0), 3).amplitude == 1.0)
    assert set(visible_images(PENTAGON, PENTAGON.mean(axis=0), 2, -0.5).amplitude) == {-0.5, 0.25}


def test_palindromes_are_first_order_echoes_of_mirrored_walls():
    """An (i, j, i) image looks like the echo of wall j mirrored in wall i: half its path is the distance to that."""
    position = TRIANGLE.mean(axis=0) + OFF_CENTRE
    images = visible_images(TRIANGLE, position, 3)
    seen = 0
    for walls, order, distance in zip(images.walls, images.order, images.distance_m, strict=True):
        if order == 3 and walls[0] == walls[2]:
            i, j = walls[:2]
            mirror = TRIANGLE[i], TRIANGLE[(i + 1) % 3]
            ghost = mirrored(TRIANGLE[j], *mirror), mirrored(TRIANGLE[(j + 1) % 3], *mirror)
            assert distance == pytest.approx(np.linalg.norm(mirrored(position, *ghost) - position))
            seen += 1
    assert seen >= 3


def test_more_images_than_first_room_for():
    images = visible_images(PENTAGON, PENTAGON.mean(axis=0) + OFF_CENTRE, 14)
    assert len(images.distance_m) > 256
    assert len(set(as_dictionary(images))) == len(images.distance_m)
    some = visible_images(PENTAGON, PENTAGON.mean(axis=0) + OFF_CENTRE, 5)
    assert set(as_dictionary(some)) == {walls for walls in as_dictionary(images) if len(walls) <= 5}


@pytest.mark.parametrize('size', [1e-3, 1.0, 1e3])
def test_size_and_place_of_the_room_do_not_matter(size):
    position = PENTAGON.mean(axis=0) + OFF_CENTRE
    images = visible_images(size * PENTAGON + size * 7, size * position + size * 7, 5)
    assert images.distance_m == pytest.approx(size * visible_images(PENTAGON, position, 5).distance_m)


@pytest.mark.parametrize('position', [(2.0, 0.1), (0.5, 0.0), (0.0, 0.0), (np.nan, 0.2)])
def test_a_position_not_inside_is_refused(position):
    with pytest.raises(ValueError, match='not inside'):
        visible_images(PENTAGON, position, 1)
