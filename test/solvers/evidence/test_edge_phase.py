"""Reflections that turn the phase: slopes against differences, and plates whose edges do against the truth."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import MediumParameters, Parameters
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.edge_phase import REAL, EdgePhase, laws
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave

ORDER = 3


def at_the_truth(scene):
    """A search, and the true walls under its waveform, not evaluated."""
    mapper = filled_mapper(scene, Parameters())
    lines = polygon_lines(Pose(*scene.poses[0]).inverse().apply(scene.vertices))
    return search_of(mapper.evidence, mapper.parameters), Walls.convex(lines)


@pytest.fixture(scope='module')
def plate():
    scene = random_scene(2, 4)
    return at_the_truth(dataclasses.replace(scene, poses=scene.poses[:20], edges=Edges(delay_deg=20.0)))


def evaluated(search, walls, edge, delay=(0.0, 0.0, 0.0, 0.0), derive=False):
    walls = dataclasses.replace(walls, delay=np.asarray(delay))
    start = search.wave.begun(walls, edge)
    return search.wave.evaluate(start.walls, dataclasses.replace(start, edge=edge), ORDER, derive)


def test_slopes_are_those_of_differences(plate):
    """At its best the device's phase has no slope of its own, and pings' amplitudes follow."""
    search, walls = plate
    held = EdgePhase(EdgePhase.of(0.2).law, np.array((0.1, 0.05, -0.05)), by_wall=True)
    delay = np.array((0.03, -0.02, 0.01, 0.0))
    found = search.wave.by_ping(dataclasses.replace(
        evaluated(search, walls, held, delay), edge=dataclasses.replace(held, free=True)), ORDER)[1].by_edge.sum(axis=0)
    for k in range(7):
        values = []
        for step in (1e-4, -1e-4):
            common, own = held.found.copy(), delay.copy()
            (common if k < 3 else own)[k if k < 3 else k - 3] += step
            values.append(evaluated(search, walls, dataclasses.replace(held, found=common), own).value)
        assert found[k] == pytest.approx((values[0] - values[1]) / 2e-4, rel=2e-2, abs=2.0)


def test_what_phases_would_gain_is_told_before_they_are_found(plate):
    search, walls = plate
    real = search.wave.refine(search.wave.begun(walls), 5)
    edge = REAL.freed()
    told = search.wave.gained(real, edge, 5)
    turned = search.wave.refine(dataclasses.replace(real, edge=edge, slopes=None), 5, 12)
    assert turned.value - real.value > 100.0
    assert told == pytest.approx(turned.value - real.value, rel=0.5)
    assert np.rad2deg(turned.edge.head_on) == pytest.approx(20.0, abs=2.0)


def solved(scene):
    estimate = filled_mapper(scene, Parameters()).solve()
    assert (estimate.status, estimate.cautions) == ('closed', ())
    comparison = compare(estimate.polygon.vertices, scene.vertices)
    assert comparison.right
    return np.abs(comparison.offsets_m).max()


@pytest.mark.parametrize(('seed', 'count', 'edges'), [
    (2, 5, Edges(kind='free', poisson=0.30)), (2, 4, Edges(delay_deg=90.0)), (4, 3, Edges(delay_deg=45.0)),
    (4, 3, Edges(spread_deg=45.0))])
def test_plates_whose_edges_turn_the_phase_are_right_and_not_doubted(seed, count, edges):
    assert solved(dataclasses.replace(random_scene(seed, count), edges=edges)) < 3e-4


def test_a_free_edge_that_is_known_is_taken_as_such():
    scene = dataclasses.replace(random_scene(2, 4), edges=Edges(kind='free', poisson=0.33),
                                told_medium=MediumParameters(edge='free'))
    assert solved(scene) < 1e-4


def test_edges_that_are_said_to_be_real_stay_so():
    """``medium.edge: real`` tries no law; with any, this plate's edges turn the phase."""
    scene = dataclasses.replace(random_scene(2, 4), edges=Edges(delay_deg=90.0),
                                told_medium=MediumParameters(edge='real'))
    mapper = filled_mapper(scene, Parameters())
    search = search_of(mapper.evidence, mapper.parameters)
    assert search.edges == laws(mapper.parameters.medium) == (REAL,)
    found = next(search.polygons())
    assert found is None or found.wave is None or not len(found.wave.edge.law)


def test_where_no_edge_turns_the_phase_none_is_found():
    mapper = filled_mapper(random_scene(2, 5), Parameters())
    search, real = search_of(mapper.evidence, mapper.parameters), None
    found = next(search.polygons())
    real = found.wave
    assert isinstance(real, Wave)
    assert real.edge is REAL
