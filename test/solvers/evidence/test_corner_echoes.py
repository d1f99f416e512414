"""What corners return is what the simulator adds by another tracer; without it walls explain what was heard."""

import dataclasses

import numpy as np
import pytest
from heard_scenes import feed

from polymap_ros.evaluation.trials import filled_mapper, judged
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.sides import Interior
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters, SensorParameters
from polymap_ros.simulation.inside import Hole
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.shaped_scenes import clean_echoes, shaped_scene
from polymap_ros.simulation.waveforms import noise_free, simulate
from polymap_ros.simulation.waves import wave_echoes
from polymap_ros.solvers.evidence.corner_echoes import corner_echoes, without_corner_echoes
from polymap_ros.solvers.evidence.corner_slopes import corner_slopes
from polymap_ros.solvers.evidence.horizon import up_to_horizon
from polymap_ros.solvers.evidence.likelihood import covariance_of, gradient_of, information_of
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.walls import Walls

SKEWED = np.array([[0.0, 0.0], [1.1, 0.1], [1.0, 0.55], [0.5, 0.5], [0.4, 1.1], [-0.1, 1.0]])
HOLE = Hole(np.array([[0.55, 0.2], [0.75, 0.22], [0.7, 0.38]]))


def skewed(**changes):
    """Twelve pings without noise in the lower arm of a skewed L, from the origin of the odometry's frame."""
    places = np.column_stack((np.linspace(0.15, 0.45, 12), 0.15 + 0.2 * np.sin(np.arange(12.0)) ** 2, np.zeros(12)))
    corners, places = SKEWED - places[0, :2], places - [*places[0, :2], 0.0]
    values = {'name': 'skewed', 'vertices': corners, 'poses': places, 'snr_db': 40.0, 'n_samples': 1024}
    return Scene(**values | changes)


def heard(scene):
    """The search over a scene's pings, and its walls' waveform where they are."""
    mapper = PolygonMapper(scene.parameters(Parameters()))
    feed(mapper, scene, simulate(scene).astype(np.float32))
    search = search_of(mapper.evidence, mapper.parameters)
    lines = [polygon_lines(scene.vertices), *(polygon_lines(hole.vertices) for hole in scene.holes)]
    interior = Interior(np.array([len(hole.vertices) for hole in scene.holes], np.int64), np.empty((0, 3)))
    walls = Walls(np.vstack(lines), np.ones(sum(map(len, lines))), interior=interior)
    return search, search.wave.evaluate(walls, search.wave.begun(walls), 5)


@pytest.mark.parametrize('changes', [
    {}, {'sensor': SensorParameters(baseline_x_m=0.04)}, {'holes': [dataclasses.replace(HOLE, vertices=HOLE.vertices - [
        0.15, 0.15])]}], ids=['alone', 'apart', 'hole'])
def test_they_are_what_the_simulator_adds(changes):
    """Loudness and phase of the device are those heard without; the noise, of which echoes are multiples, differs."""
    (plain, wave), (faded, _) = (heard(skewed(edge_fading=fading, **changes)) for fading in ('none', 'fresnel'))
    near = slice(plain.data.first_cell * round(plain.data.cell_m / plain.data.pulse.step_m), None)
    added, predicted = (faded.data.signal - plain.data.signal)[:, near], corner_echoes(plain.data, wave)[:, near]
    scale = np.vdot(predicted, added) / np.vdot(predicted, predicted)
    assert abs(scale - 1.0) < 0.1
    assert np.sum(np.abs(added - scale * predicted) ** 2) < 0.1 * np.sum(np.abs(added) ** 2)


def test_without_them_walls_explain_what_was_heard():
    search, wave = heard(skewed(edge_fading='fresnel'))
    rest = search.over(without_corner_echoes(search.data, wave))
    left = [1.0 - each.as_modelled(wave) for each in (search, rest)]
    assert left[1] < 0.2 * left[0]


def test_walls_are_known_as_well_as_what_is_taken_out_with_them_leaves_them():
    """The gradient changes as said where corners return what slightly other walls make, of all pings, not of half."""
    search, wave = heard(skewed(edge_fading='fresnel'))
    wave = search.over(without_corner_echoes(search.data, wave)).wave.refine(wave, 5)
    information = information_of(wave)
    found = corner_slopes(search.data, wave, information)
    step = np.random.default_rng(1).normal(size=len(found)) * np.sqrt(np.diag(covariance_of(information)))
    step[2 * len(wave.walls):] = 0.0
    gradients = []
    for sign in (1.0, -1.0):
        moved = wave.with_walls(wave.walls.moved(sign * step))
        rest = search.over(without_corner_echoes(search.data, moved))
        gradients.append(gradient_of(rest.wave.evaluate(wave.walls, wave, 5, derive=True)))
    scale = np.sqrt(np.diag(covariance_of(information)))
    change, said = 0.5 * (gradients[0] - gradients[1]) * scale, found @ step * scale
    assert np.linalg.norm(change) > 0.05
    assert np.linalg.norm(said - change) < 0.5 * np.linalg.norm(change)


def test_the_horizon_is_where_the_sixth_reflection_begins():
    scene = skewed()
    search, wave = heard(scene)
    nearest = []
    for x, y, _ in scene.poses:
        images = visible_images(scene.vertices, (x, y), 6)
        nearest.append(0.5 * images.distance_m[images.order == 6].min())
    data = up_to_horizon(search.data, wave.walls)
    assert data.range_max_m == pytest.approx(np.quantile(nearest, 0.1), abs=2e-3)
    assert (data.power.shape[1] - 1) * data.cell_m == pytest.approx(data.range_max_m, abs=data.cell_m)


@pytest.mark.parametrize(('seed', 'edges'), [(2, 5), (117, 4)])
def test_convex_plates_with_real_corners_need_no_warning(seed, edges):
    scene = random_scene(seed, edges)
    faded = dataclasses.replace(scene, edge_fading='fresnel')
    mapper = filled_mapper(scene, Parameters(), noise_free(faded))
    trial = judged(mapper.solve(), scene, 'evidence', 0.0)
    assert (trial.right, trial.cautions) == (True, ())
    assert max(trial.offsets_m) < 1e-4


@pytest.mark.parametrize(('kind', 'seed'), [('l', 2), ('skewed_l', 15)])
def test_an_l_with_real_corners_is_mapped(kind, seed):
    """In the second a short edge stood in the place of a corner, unless what corners return is taken out without it."""
    scene = shaped_scene(kind, seed)
    mapper = filled_mapper(scene, Parameters(), clean_echoes(scene, 'fresnel'))
    trial = judged(mapper.solve(), scene, 'evidence', 0.0)
    assert (trial.right, trial.cautions) == (True, ())
    assert max(trial.offsets_m) < 2e-4


def test_in_echoes_of_the_wave_equation_little_is_left():
    """In a plate so small that the wave equation is solved in seconds, before a sixth reflection may be heard."""
    scene = skewed()
    small = skewed(vertices=0.5 * scene.vertices, poses=scene.poses * [0.5, 0.5, 1.0], n_samples=260)
    mapper = filled_mapper(small, Parameters(), wave_echoes(small))
    search = search_of(mapper.evidence, mapper.parameters)
    walls = Walls(polygon_lines(small.vertices), np.ones(6))
    wave = search.wave.evaluate(walls, search.wave.begun(walls), 5)
    rest = search.over(without_corner_echoes(search.data, wave))
    left = [1.0 - each.as_modelled(wave) for each in (search, rest)]
    assert left[1] < 0.5 * left[0]
    assert left[0] > 0.02
