"""Echoes of round walls: by rays against the exact series of a cylinder, and against the wave equation."""

import numpy as np
import pytest
import scipy.special

from polymap_ros.simulation.reflectors import Reflectors, heard_images
from polymap_ros.simulation.round_paths import heard_paths
from polymap_ros.simulation.waves import scattered

FAR = np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]])
PLATE = np.array([[0.0, 0.0], [0.9, 0.05], [0.85, 0.7], [0.1, 0.6]])
SEAM = ([0.2, 0.1], [0.3, 0.55], 0.4)
ROOM = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.4], [0.0, 0.4]])


def series(wavenumber, radius, source, place, rigid=True):
    """What a cylinder at the origin scatters of H_0(k d) / 4j, for two places round it."""
    near, far = np.hypot(*source), np.hypot(*place)
    turn = np.arctan2(*source[::-1]) - np.arctan2(*place[::-1])
    order = np.arange(int(wavenumber * radius) + 40)
    bessel, hankel = (scipy.special.jvp, scipy.special.h2vp) if rigid else (scipy.special.jv, scipy.special.hankel2)
    terms = bessel(order, wavenumber * radius) / hankel(order, wavenumber * radius)
    terms *= scipy.special.hankel2(order, wavenumber * near) * scipy.special.hankel2(order, wavenumber * far)
    return 0.25j * np.sum(np.where(order > 0, 2.0, 1.0) * terms * np.cos(order * turn))


def by_rays(wavenumber, lengths, amplitudes):
    """Sum of sources of H_0(k d) / 4j at these distances."""
    return np.sum(amplitudes * -0.25j * scipy.special.hankel2(0, wavenumber * lengths))


@pytest.mark.parametrize(('source', 'place'), [
    ((0.3, 0.0), (0.3, 0.0)), ((0.5, 0.1), (0.5, 0.1)), ((0.3, 0.05), (0.1, 0.35)), ((0.2, 0.1), (0.0, 0.9))], ids=str)
@pytest.mark.parametrize('rigid', [True, False])
def test_an_echo_of_a_cylinder_is_that_of_its_series(source, place, rigid):
    """Amplitude and phase, but for a share that falls with the number of wavelengths in the radius."""
    radius, off = 0.1, []
    for wavenumber in (300.0, 1200.0):
        length, amplitude = heard_paths(
            Reflectors.outline(FAR), [(0.0, 0.0, radius, 1.0 if rigid else -1.0)], source, place, 1)
        exact = series(wavenumber, radius, np.array(source), np.array(place), rigid)
        if place != source:  # the series has the way straight on nowhere, nor do these paths
            assert length[0] > np.hypot(*np.subtract(source, place))
        off.append(abs(by_rays(wavenumber, length[:1], amplitude[:1]) / exact - 1.0))
    assert off[0] < 0.05
    assert off[1] < 0.35 * off[0]


def test_beside_a_straight_wall_a_bend_is_weaker_by_the_root_of_a_over_a_and_s():
    length, amplitude = heard_paths(Reflectors.outline(FAR), [(0.0, 0.0, 0.2, 0.7)], (0.5, 0.0), (0.5, 0.0), 1)
    assert length[0] == pytest.approx(0.6)
    assert amplitude[0] == pytest.approx(0.7 * np.sqrt(0.2 / (0.2 + 0.3)))


def test_without_circles_the_paths_are_those_of_images():
    walls = Reflectors.outline(PLATE, (0.9, 0.8, -0.7, 1.0)).with_seam(*SEAM)
    for place in ((0.6, 0.3), (0.15, 0.3)):
        images, amplitude = heard_images(walls, (0.6, 0.3), 4, place)
        found = heard_paths(walls, (), (0.6, 0.3), place, 4)
        np.testing.assert_allclose(found[0], np.linalg.norm(images - np.array(place), axis=1), atol=3e-7)
        np.testing.assert_allclose(np.sort(found[1]), np.sort(amplitude), atol=1e-12)


def test_a_path_by_walls_and_circles_is_shortest_and_reflected_alike_on_both_sides():
    """Of a path circle, wall, circle: its length against a minimum over both angles."""
    from scipy.optimize import minimize

    circles = np.array([(0.35, 0.3, 0.06, 1.0), (0.6, 0.35, 0.08, 1.0)])
    source, place = np.array((0.2, 0.2)), np.array((0.75, 0.2))

    def length(angles):
        one, other = circles[:, :2] + circles[:, 2:3] * np.column_stack((np.cos(angles), np.sin(angles)))
        other_below = other * (1.0, -1.0)  # in the wall y = 0
        return np.hypot(*(source - one)) + np.hypot(*(one - other_below)) + np.hypot(*(other - place))

    floor = Reflectors(np.array([[-9.0, 0.0]]), np.array([[9.0, 0.0]]), np.ones(1), np.zeros(1))
    expected = minimize(length, (-2.0, -1.0), tol=1e-14)
    found = heard_paths(floor, circles, source, place, 3)[0]
    assert np.abs(found - expected.fun).min() < 1e-6


def test_what_a_round_hole_changes_in_a_plate_is_what_the_wave_equation_has():
    """By all paths, over two bends, too; what creeps round the hole and fades at its shadow's edge is left."""
    wavenumber, hole, outline = 1200.0 - 5.0j, (0.28, 0.17, 0.06, 1.0), Reflectors.outline(ROOM)
    emitters = np.array([(0.1, 0.12), (0.42, 0.33), (0.18, 0.12), (0.07, 0.3)])
    receivers = np.array([*emitters[:3], (0.2, 0.03)])
    plain, pierced = (scattered([ROOM], emitters, receivers, wavenumber, circles) for circles in ((), [hole]))
    rays = np.array([[by_rays(wavenumber, *heard_paths(outline, circles, *ends, 7)) for circles in ((), [hole])]
                     for ends in zip(emitters, receivers, strict=True)])
    np.testing.assert_allclose(rays[:, 0], plain, rtol=1e-3)
    assert (np.abs(rays[:, 1] - pierced) < 0.08 * np.abs(pierced - plain)).all()


def test_an_image_on_the_circle_itself_makes_no_path_and_no_error():
    """Between parallel walls there are such images for some radii."""
    walls = Reflectors.outline(ROOM)
    for radius in (0.05, 0.1 + 3e-10, 0.1, 0.125):
        lengths, amplitudes = heard_paths(walls, [(0.25, 0.2, radius, 1.0)], (0.05, 0.2), (0.05, 0.2), 5)
        assert np.isfinite(lengths).all()
        assert (np.abs(amplitudes) <= 1.0 + 1e-9).all()
