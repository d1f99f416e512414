"""Round holes: found by first echoes, and plates with one mapped from beginning to end."""

import dataclasses

import numpy as np
import pytest
import shapely

from polymap_ros.evaluation.trials import filled_mapper, judged
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.inside import Hole, RoundHole
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.shaped_scenes import shaped_scene
from polymap_ros.solvers.evidence.rings import RingFeet
from polymap_ros.solvers.evidence.round_echoes import best_circle, first_echoes_in_phase

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.8], [0.0, 0.8]])


def test_a_circle_is_found_by_ranges_alone():
    """Evidence is 1 at a cell at the range of a circle's first echo, and less than nothing elsewhere."""
    generator = np.random.default_rng(2)
    places = generator.uniform((0.05, 0.05), (0.95, 0.75), (60, 2))
    places = places[np.hypot(*(places - (0.6, 0.45)).T) > 0.2]
    ranges = np.hypot(*(places - (0.6, 0.45)).T) - 0.13
    evidence = np.full((len(places), 300), -0.1)
    for number, cell in enumerate(np.round(ranges / 0.005).astype(int)):
        evidence[number, cell - 1:cell + 2] = 1.0
    feet = RingFeet(places, evidence, 0.005, ranges, 0.02, 0.01)
    value, x, y, radius = best_circle(feet, CORNERS, 0.004, 0.04, 0.3)
    assert value > 0.9 * len(places)
    assert np.hypot(x - 0.6, y - 0.45) < 0.008
    assert abs(radius - 0.13) < 0.006


def test_first_echoes_add_up_in_phase_at_the_circle_only():
    generator = np.random.default_rng(3)
    places = generator.uniform(0.0, 1.0, (40, 2)) + (1.0, 0.0)
    ends, carrier, step = np.column_stack((places, places, np.zeros(40))), 300.0, 0.001
    half = np.hypot(*(places - (0.4, 0.5)).T) - 0.1
    ranges = step * np.arange(2500)
    signal = np.exp(-0.5 * ((ranges - half[:, None]) / 0.01) ** 2) * np.exp(0.7j - 2j * carrier * half[:, None])
    there = first_echoes_in_phase(signal, ends, np.ones(40), carrier, step, 0.5, 0.4, 0.5, 0.1)[0]
    aside = first_echoes_in_phase(signal, ends, np.ones(40), carrier, step, 0.5, 0.4, 0.512, 0.1)[0]
    assert np.angle(there) == pytest.approx(0.7, abs=1e-3)
    assert abs(aside) < 0.5 * abs(there)
    assert first_echoes_in_phase(signal, ends, np.ones(40), carrier, step, 0.5, 0.4, 0.5, -0.1) == (0.0, 0.0)


def solved(scene):
    mapper = filled_mapper(scene, Parameters())
    return mapper.solve()


def test_a_plate_with_a_round_hole_is_mapped():
    """The hole is a polygon of the circle's area, round its middle, and as well known as it is off."""
    scene = shaped_scene('round_hole', 8)
    estimate = solved(scene)
    trial, ((x, y, radius, _),) = judged(estimate, scene, 'evidence', 1.0), scene.circles
    assert trial.right
    assert not trial.flagged
    hole, = estimate.holes
    shape = shapely.Polygon(hole.vertices)
    assert np.sqrt(shape.area / np.pi) == pytest.approx(radius, abs=1e-3)
    assert np.hypot(shape.centroid.x - x, shape.centroid.y - y) < 1e-3
    for edge in hole.edges:
        towards = x * np.cos(edge.theta) + y * np.sin(edge.theta) - edge.r
        assert towards == pytest.approx(radius, rel=0.015)  # the normal points into the hole
        assert 0.0 < edge.r_std < 1e-3
        assert edge.likelihood == 1.0


def test_a_round_hole_is_kept_and_refined_as_pings_come():
    scene = shaped_scene('round_hole', 8)
    mapper = filled_mapper(dataclasses.replace(scene, poses=scene.poses[:76]), Parameters())
    first = mapper.solve()
    again = mapper.solve()  # the last answer is refined, nothing is searched for
    assert [len(estimate.holes) for estimate in (first, again)] == [1, 1]
    assert again.status == 'closed'
    assert not again.cautions


def test_a_rectangular_hole_does_not_become_a_round_one():
    scene = shaped_scene('round_hole', 8)
    (x, y, radius, _), = scene.circles
    square = radius * np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)]) + (x, y)
    estimate = solved(Scene('square', scene.vertices, scene.poses, seed=8, holes=(Hole(square),)))
    assert isinstance(scene.holes[0], RoundHole)
    assert all(len(hole.edges) == 4 for hole in estimate.holes)
