"""Directions of a device and losses of a medium, found from echoes that the simulator makes by other formulas."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.propagation import Propagation
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.loudness import PLAIN
from polymap_ros.solvers.evidence.search import search_of


@pytest.fixture(scope='module')
def scene():
    return random_scene(4, 5)


def found_in(scene):
    """The first polygon of a search that was told nothing, and the search."""
    mapper = filled_mapper(scene, Parameters())
    search = search_of(mapper.evidence, mapper.parameters)
    return next(each for each in search.polygons() if each is not None), search


def offset_error_m(found, scene):
    """The greatest difference of the distance from the first sensor position, wall by wall."""
    normals = np.column_stack((np.cos(found.lines[:, 1]), np.sin(found.lines[:, 1])))
    along = np.roll(scene.vertices, -1, axis=0) - scene.vertices
    true = np.column_stack((along[:, 1], -along[:, 0])) / np.hypot(*along.T)[:, None]
    distances = np.einsum('ij,ij->i', true, scene.vertices - scene.positions[0])
    assert len(normals) == len(true)
    return np.abs(np.sort(found.lines[:, 0]) - np.sort(distances)).max()


def test_a_device_that_is_louder_ahead_is_heard_as_one(scene):
    found, search = found_in(dataclasses.replace(scene, faults=Faults(directivity=0.3)))
    assert found.wave.loudness.ahead == pytest.approx(0.3, abs=0.02)
    assert found.wave.loudness.left == pytest.approx(0.0, abs=0.02)
    assert found.explained > 0.98
    plain = search.wave.refine(dataclasses.replace(found.wave, loudness=PLAIN, slopes=None), 5)
    assert search.as_modelled(plain) < 0.95
    assert offset_error_m(found, scene) < 1e-4


def test_what_the_way_takes_leans_the_spectrum():
    scene = random_scene(2, 4)
    found, _ = found_in(dataclasses.replace(scene, propagation=Propagation(attenuation_np_m=0.35)))
    hz = scene.pulse.frequency_hz
    # exp(-a f / f0 d) with f - f0 = v (k - k0) / 2 pi, over the way there and back
    lean = 0.35 * float(group_speed(make_medium(scene.medium), hz)) / (2.0 * np.pi * hz)
    assert found.wave.loudness.lean == pytest.approx(lean, rel=0.1)
    assert found.wave.loudness.loss == pytest.approx(0.35, abs=0.12)  # much of it is what walls may take, too
    assert found.explained > 0.98
    assert offset_error_m(found, scene) < 1e-4


def test_what_reflections_delay_an_echo_by_is_told_from_where_walls_are(scene):
    late_s = 0.25 / scene.pulse.frequency_hz
    found, _ = found_in(dataclasses.replace(scene, edges=Edges(delay_s=late_s)))
    speed = float(group_speed(make_medium(scene.medium), scene.pulse.frequency_hz))
    assert found.wave.loudness.late == pytest.approx(0.5 * speed * late_s, rel=0.1)
    assert abs(found.wave.edge.head_on) == pytest.approx(0.5 * np.pi, abs=0.3)  # but for the sign
    assert found.explained > 0.98
    assert offset_error_m(found, scene) < 2e-4  # heard late, all walls would be 3.7 mm off


def test_a_late_envelope_is_predicted_where_it_is(scene):
    found, search = found_in(scene)

    def predicted(strengths, late_m):
        loudness = found.wave.loudness._replace(strengths=np.array(strengths), late=late_m)
        return search.wave.without_carrier(dataclasses.replace(found.wave, loudness=loudness))

    for reflections, strengths in enumerate(((1.0, 0.0), (0.0, 1.0)), 1):
        moved = np.roll(predicted(strengths, 0.0), 3 * reflections, axis=1)
        late = predicted(strengths, 3.0 * search.data.cell_m)
        assert np.abs(late - moved)[:, 40:].max() < 1e-6 * np.abs(moved).max()


def test_of_a_plain_device_nothing_is_made_up(scene):
    found, _ = found_in(scene)
    assert found.wave.loudness[1:] == (0.0, 0.0, 0.0, 0.0, 0.0)
