"""Echoes by the wave equation against images where those are exact, and against finite differences where not."""

import dataclasses

import numpy as np
import pytest
import scipy.special

from polymap_ros.errors import SceneError
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.parameters import MediumParameters, SensorParameters
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.inside import Partition
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import noise_free
from polymap_ros.simulation.waves import scattered, wave_echoes

RECTANGLE = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.37], [0.0, 0.37]])
L_SHAPE = np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.16], [0.2, 0.16], [0.2, 0.36], [0.0, 0.36]])


def scene(**changes):
    poses = np.array([[0.13, 0.11, 0.0], [0.3, 0.2, 1.0], [0.06, 0.26, 2.0]])
    poses[:, :2] *= 0.5
    values = {'name': 'plate', 'vertices': 0.5 * RECTANGLE, 'poses': poses, 'n_samples': 150}
    return Scene(**values | changes)


@pytest.mark.parametrize(('wavenumber', 'apart'), [(100.0 - 8.0j, 0.0), (300.0 - 8.0j, 0.0), (300.0 - 8.0j, 0.03)])
def test_in_a_rectangle_the_field_is_that_of_all_images(wavenumber, apart):
    emitters = np.array([[0.13, 0.11], [0.3, 0.2], [0.06, 0.06]])
    receivers = emitters + apart
    exact = []
    for emitter, receiver in zip(emitters, receivers, strict=True):
        images = visible_images(RECTANGLE, emitter, 30, 1.0, receiver)
        exact.append(np.sum(-0.25j * scipy.special.hankel2(0, wavenumber * images.distance_m)))
    np.testing.assert_allclose(scattered([RECTANGLE], emitters, receivers, wavenumber), exact, rtol=1e-4)


@pytest.mark.parametrize('changes', [
    {'t0_s': 3.03e-5}, {'t0_s': -2e-5}, {'sensor': SensorParameters(baseline_x_m=0.03)}], ids=str)
def test_in_a_rectangle_the_echoes_are_those_of_images(changes):
    """But for a thousandth of the amplitude of what comes after the window, and for g, which is H_0 near the source."""
    plate = scene(order=16, **changes)
    waves, images = wave_echoes(plate), noise_free(plate)
    assert np.sum((waves - images) ** 2) < 1e-3 * np.sum(images**2)


def finite_differences(wavenumber, source, receiver, cell):
    """G from source to receiver in the L at complex k, by the leap-frog scheme for waves of speed 1.

    Damped as k is, what comes late does not count, and the transform of a finite time is that of all.
    """
    size = np.round(L_SHAPE.max(axis=0) / cell).astype(int)
    x, y = (np.arange(count)[:, None] * cell + 0.5 * cell for count in size)
    room = ((x < 0.2) | (y.T < 0.16)).astype(float)
    right, up = room[1:] * room[:-1], room[:, 1:] * room[:, :-1]
    step = cell / np.sqrt(2.0) * 0.99
    at, to = (tuple(np.floor(np.asarray(place) / cell).astype(int)) for place in (source, receiver))
    width = 1.2 / wavenumber.real
    before, here, total, sent = np.zeros(size), np.zeros(size), 0.0j, 0.0j
    for number in range(int(8.0 / abs(wavenumber.imag) / step)):
        time = number * step
        pulse = (time / width - 5.0) * np.exp(-0.5 * (time / width - 5.0) ** 2)
        flow_x, flow_y = right * np.diff(here, axis=0), up * np.diff(here, axis=1)
        change = np.zeros(size)
        change[:-1] += flow_x
        change[1:] -= flow_x
        change[:, :-1] += flow_y
        change[:, 1:] -= flow_y
        turned = np.exp(-1j * wavenumber * time)
        total, sent = total + here[to] * turned, sent + pulse * turned
        change[at] += pulse
        before, here = here, 2.0 * here - before + (step / cell) ** 2 * change
    return total / sent


@pytest.mark.parametrize(('source', 'receiver'), [((0.301, 0.081), (0.061, 0.281)), ((0.141, 0.181), (0.261, 0.121))])
def test_round_a_corner_the_field_is_that_of_finite_differences(source, receiver):
    """Where no wave comes without being diffracted, and where some do; k as large as 12 cells a radian allow."""
    wavenumber, cell = 40.0 - 6.0j, 0.002
    found = scattered([L_SHAPE], np.array([source]), np.array([receiver]), wavenumber)[0]
    found += -0.25j * scipy.special.hankel2(0, wavenumber * np.hypot(*np.subtract(source, receiver)))
    expected = finite_differences(wavenumber, source, receiver, cell)
    assert abs(found - expected) < 0.02 * abs(expected)


@pytest.mark.parametrize(('changes', 'word'), [
    ({'reflection': 0.9}, 'set reflection to 1'),
    ({'inner_walls': [Partition(np.array([0.1, 0.1]), np.array([0.2, 0.3]), 0.4)]}, 'leave out inner_walls'),
    ({'edges': Edges(delay_deg=45.0)}, 'leave out edges'),
    ({'medium': MediumParameters(model='constant')}, 'medium.model constant'),
    ({'faults': Faults(missing_first=0.2)}, 'missing_first'),
])
def test_what_it_does_not_know_is_refused(changes, word):
    with pytest.raises(SceneError, match=word):
        wave_echoes(dataclasses.replace(scene(), **changes))
