"""Walls that are curved a little and corners that are rounded, found in echoes that another tracer makes."""

import dataclasses
import re

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper, judged
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.results.polygon_json import polygon_document
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.wording import as_a_curve


def solved(scene):
    mapper = filled_mapper(scene, Parameters())
    return mapper, mapper.solve()


@pytest.mark.parametrize(('seed', 'edges', 'radius_m'), [(4, 6, 100.0), (4, 6, -20.0), (2, 4, 20.0)])
def test_a_curved_wall_is_found_and_told(seed, edges, radius_m):
    bent = Edges(curvature_1_m=1.0 / radius_m, curved_edge=seed % edges)
    scene = dataclasses.replace(random_scene(seed, edges), edges=bent)
    mapper, answer = solved(scene)
    trial = judged(answer, scene, 'evidence', 0.0)
    assert trial.right
    assert trial.cautions == ('curved_edge',)
    assert max(trial.offsets_m) < 2e-4
    curved = [edge for edge in answer.polygon.edges if edge.curvature]
    assert len(curved) == 1
    assert curved[0].curvature == pytest.approx(1.0 / radius_m, rel=0.1)
    assert curved[0].curvature == pytest.approx(1.0 / radius_m, abs=3.0 * curved[0].curvature_std)
    document = polygon_document(answer, 'odom', mapper.counts, mapper.parameters)
    told = [edge for edge in document['edges'] if 'curvature' in edge]
    assert [edge['curvature'] for edge in told] == [curved[0].curvature]
    assert told[0]['curvature_std'] > 0.0
    side = 'outwards' if radius_m > 0.0 else 'inwards'
    assert f'bulges {side}: a radius of {1.0 / abs(curved[0].curvature):.3g} m' in document['warnings'][0]['text']
    moved = answer.polygon.moved(Pose(1.0, 2.0, 3.0))
    assert [edge.curvature for edge in moved.edges] == [edge.curvature for edge in answer.polygon.edges]


def test_a_straight_plate_has_no_curved_wall():
    _, answer = solved(random_scene(4, 6))
    assert all(edge.curvature == 0.0 and edge.curvature_std == 0.0 for edge in answer.polygon.edges)


def test_a_wall_that_was_bent_on_the_way_is_straight_in_the_end():
    """Five edges by power, one of which is bent, until one of them goes."""
    _, answer = solved(random_scene(101, 4))
    assert answer.cautions == ()


def test_edges_in_a_row_that_turn_hardly_are_told_of_as_a_curve():
    arc = [(1.0, t) for t in np.deg2rad((80.0, 84.0, 88.0, 92.0))]
    walls = Walls(np.array([(1.0, -0.5 * np.pi), (1.0, 0.0), *arc, (1.0, np.pi)]), np.ones(7))
    assert walls.slight_run(np.deg2rad(6.0)) == [2, 3, 4, 5]
    assert walls.slight_run(np.deg2rad(3.0)) == []
    caution = as_a_curve([2, 3, 4, 5])
    assert caution.code == 'curved_edge'
    assert '2, 3, 4, 5' in caution.text
    assert not any(Walls.of_polygon(random_scene(seed, 8).vertices).slight_run(np.deg2rad(6.0)) for seed in range(50))


@pytest.mark.parametrize('variant', ['curved_20', 'curved_100'])
def test_variants_bend_one_edge(variant):
    bends = {float(VARIANTS[variant].make(seed, 5).edges.curvature_1_m) for seed in range(8)}
    assert len(bends) == 2
    np.testing.assert_allclose(np.abs(sorted(bends)), 1.0 / float(variant.split('_')[1]))


@pytest.mark.parametrize(('seed', 'edges', 'radius_m'), [(2, 3, 0.02), (4, 6, 0.02), (0, 5, 0.01)])
def test_rounded_corners_are_found_and_told(seed, edges, radius_m):
    scene = dataclasses.replace(random_scene(seed, edges), edges=Edges(corner_radius_m=radius_m))
    mapper, answer = solved(scene)
    trial = judged(answer, scene, 'evidence', 0.0)
    assert trial.right
    assert trial.cautions == ('rounded_corners',)
    assert max(trial.offsets_m) < 1e-4
    told_mm, deviation_mm = map(float, re.findall(r'[0-9.]+(?= mm)', answer.cautions[0].finding))
    assert abs(told_mm - 1e3 * radius_m) < 3.0 * deviation_mm < 2.0
    moved = answer.moved(Pose(1.0, 2.0, 0.5))
    document = polygon_document(moved, 'map', mapper.counts, mapper.parameters)
    assert document['corner_radius'] == pytest.approx(1e-3 * told_mm, abs=5e-5)
    assert document['corner_radius_std'] == pytest.approx(1e-3 * deviation_mm, abs=5e-5)


def test_without_their_curved_wall_walls_are_straight_ones():
    walls = Walls.of_polygon(random_scene(4, 6).vertices).with_bend(np.array([(0.0, 0.1)] * 5 + [(0.05, 0.2)]))
    assert len(walls.without(2).bend) == 5
    assert len(walls.without(5).bend) == 0
