"""Rings of lines judged by first echoes, against shapely; how they are found, changed and judged by the likelihoods."""

import dataclasses

import numpy as np
import pytest
import shapely

from polymap_ros.evaluation.shapes_experiment import ShapesExperiment
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.outline import are_inside, corners_of
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.clearance import audible_feet
from polymap_ros.simulation.shaped_scenes import SHAPE_KINDS, clean_echoes, shaped_scene
from polymap_ros.simulation.waveforms import noise_free
from polymap_ros.solvers.evidence.closed_walks import COSTS, closed_walks
from polymap_ros.solvers.evidence.moves.retune import retune
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.moves.wall_drop import merge_walls
from polymap_ros.solvers.evidence.oriented_lines import oriented_lines
from polymap_ros.solvers.evidence.proposals import first_strength
from polymap_ros.solvers.evidence.ring_annealing import annealed
from polymap_ros.solvers.evidence.ring_changes import changes, notched
from polymap_ros.solvers.evidence.ring_search import improved_ring, ring_starts
from polymap_ros.solvers.evidence.rings import PRICE_OF_EDGE, UNEXPLAINED, RingFeet, inside, ring_evidence, ring_feet
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.walls import Walls

U = np.array([[0.0, 0.0], [1.5, 0.0], [1.5, 1.2], [1.0, 1.2], [1.0, 0.5], [0.45, 0.5], [0.45, 1.2], [0.0, 1.2]])
CELL_M = 0.004


def searching(kind, seed):
    """A search over what the pings of a scene hear, the outline in its frame, and its lines."""
    scene = shaped_scene(kind, seed)
    mapper = filled_mapper(scene, Parameters(), clean_echoes(scene))
    corners = mapper.start_pose.inverse().apply(scene.vertices)
    return search_of(mapper.evidence, Parameters()), corners, np.ascontiguousarray(polygon_lines(corners))


@pytest.fixture(scope='module')
def in_l():
    return searching('l', 2)


def overlap(lines, corners):
    """IoU of what a ring of lines bounds with a polygon, by shapely."""
    found, truth = shapely.Polygon(corners_of(np.ascontiguousarray(lines))[1]), shapely.Polygon(corners)
    return found.intersection(truth).area / found.union(truth).area


def heard_in(corners, count=60, seed=0, evidence=8.0):
    """Feet of pings in an outline, that are heard where they are, and nowhere else; by shapely."""
    generator, free = np.random.default_rng(seed), shapely.Polygon(corners).buffer(-0.06)
    places = generator.uniform(corners.min(axis=0), corners.max(axis=0), (40 * count, 2))
    places = np.ascontiguousarray(places[shapely.contains_xy(free, *places.T)][:count])
    audible, lines = audible_feet(corners, places), polygon_lines(corners)
    away = lines[:, 0] - places @ np.array((np.cos(lines[:, 1]), np.sin(lines[:, 1])))
    table = np.full((count, 600), -3.0)
    for ping, wall in np.argwhere(audible):
        cell = int(away[ping, wall] / CELL_M)
        table[ping, max(cell - 2, 0):cell + 4] = evidence
    first = np.where(audible, away, np.inf).min(axis=1)
    return RingFeet(places, table, CELL_M, first, 0.015, 0.02)


@pytest.mark.parametrize('kind', SHAPE_KINDS)
def test_inside_is_shapelys(kind):
    corners = SHAPE_KINDS[kind].corners(np.random.default_rng(1))
    places = np.random.default_rng(2).uniform(-0.3, 1.8, (500, 2))
    expected = shapely.contains_xy(shapely.Polygon(corners), *places.T)
    assert [inside(corners, *place) for place in places.tolist()] == expected.tolist()
    assert are_inside(corners, places).tolist() == expected.tolist()


@pytest.mark.parametrize('kind', SHAPE_KINDS)
def test_the_evidence_of_a_ring_is_that_of_its_feet_in_plain_sight(kind):
    """Each foot counts 0.5, too little to be heard; shapely says which are in sight, and how long the edges are."""
    corners = SHAPE_KINDS[kind].corners(np.random.default_rng(3))
    feet = heard_in(corners, evidence=0.5)
    feet = feet._replace(evidence=np.full_like(feet.evidence, 0.5), near=1e-9)
    lines = np.ascontiguousarray(polygon_lines(corners))
    audible = audible_feet(corners, feet.positions)
    expected = 0.5 * audible.sum() - PRICE_OF_EDGE * len(lines) - 40.0 * shapely.Polygon(corners).exterior.length
    assert ring_evidence(lines, feet) == pytest.approx(expected, abs=1e-6)
    late = feet._replace(first=feet.first + 1.0)
    assert ring_evidence(lines, late) == pytest.approx(expected - UNEXPLAINED * len(feet.first), abs=1e-6)
    outside = feet._replace(positions=feet.positions + 5.0)
    assert ring_evidence(lines, outside) < -1e11


def test_an_echo_counts_once():
    """In the middle of a square all four walls are as far away."""
    lines = np.column_stack((np.ones(4), 0.5 * np.pi * np.arange(4)))
    feet = RingFeet(np.zeros((1, 2)), np.full((1, 600), 0.5), CELL_M, np.ones(1), 0.01, 0.02)
    assert ring_evidence(lines, feet) == pytest.approx(0.5 - 4.0 * PRICE_OF_EDGE - 40.0 * 8.0)


def test_a_u_is_found_from_a_rectangle_by_a_notch():
    feet, lines = heard_in(U), np.ascontiguousarray(polygon_lines(U))
    rectangle = np.array([0, 1, 2, 7])
    ring, score = notched(lines, rectangle, ring_evidence(lines[rectangle], feet), feet, 10)
    assert overlap(lines[ring], U) > 0.999
    assert score == pytest.approx(ring_evidence(lines[ring], feet))
    assert score == pytest.approx(ring_evidence(lines, feet), abs=1e-6)


def test_the_true_ring_is_among_the_changes_of_one_with_a_wrong_corner():
    """The bottom of the U's notch is a tenth of a metre too far out."""
    feet, lines = heard_in(U), np.ascontiguousarray(polygon_lines(U))
    wrong = lines + np.where(np.arange(8)[:, None] == 4, (0.1, 0.0), 0.0)
    rings = changes(np.vstack((wrong, lines)), 8, feet, 10)
    pool = np.vstack((wrong, lines))
    assert max(overlap(pool[ring], U) for ring in rings) > 0.999


def test_annealing_never_ends_below_its_start_and_mends_a_wall():
    feet, lines = heard_in(U), np.ascontiguousarray(polygon_lines(U))
    generator = np.random.default_rng(4)
    clutter = np.column_stack((generator.uniform(-0.5, 1.8, 40), generator.uniform(-np.pi, np.pi, 40)))
    pool = np.vstack((lines, lines[4] + (0.15, 0.0), clutter))
    start = np.array([0, 1, 2, 3, 8, 5, 6, 7])
    ring, score = annealed(pool, np.ones(len(pool)), start, feet, 10, 20_000, generator)
    assert score > ring_evidence(pool[start], feet)
    assert overlap(pool[ring], U) > 0.97


def test_walks_of_an_l_and_its_start(in_l):
    search, corners, _ = in_l
    data, nothing = search.data, search.nothing.expected
    strength = first_strength(data, nothing)
    pool = oriented_lines(data, nothing, strength, 60).lines
    feet = ring_feet(data, nothing, strength)
    walks = [ring for costs in COSTS for ring in closed_walks(data, pool, feet, costs)]
    assert all(corners_of(np.ascontiguousarray(pool[ring]))[0] for ring in walks)
    assert max(overlap(pool[ring], corners) for ring in walks) > 0.9
    starts, pool = ring_starts(search)
    assert len({round(start.value) for start in starts}) == len(starts) > 1
    better = improved_ring(search, starts[0], pool)
    assert better.value >= starts[0].value
    assert overlap(better.walls.lines, corners) > 0.99


def test_a_wall_that_is_off_at_one_end_is_turned_back(in_l):
    search, _, lines = in_l
    right = search.wave.refine(search.wave.begun(Walls(lines, np.ones(6))), 5)
    middle = 0.5 * (np.roll(corners_of(lines)[1], -1, axis=0) + corners_of(lines)[1])[3]
    turn = search.cycle_m / 0.5
    along = middle[1] * np.cos(lines[3, 1]) - middle[0] * np.sin(lines[3, 1])
    turned = right.walls.lines.copy()
    turned[3] += along * turn, turn
    wrong = search.wave.evaluate(right.walls.on(turned), right, 5)
    power = search.nothing.with_walls(wrong.walls)
    mended = retune(search, Standing(power, wrong, search.explained(wrong)))
    assert mended.value > wrong.value
    np.testing.assert_allclose(mended.walls.lines[3], lines[3], atol=2e-3)
    assert retune(search, Standing(power, right, 0.99)) is None


def test_two_edges_that_share_a_wall_become_one(in_l):
    search, _, lines = in_l
    turns = np.array([0.0, 2e-3])
    twice = np.insert(lines, 1, lines[0] + turns, 0)
    middle = 0.5 * (corners_of(lines)[1][0] + corners_of(lines)[1][1])
    twice[:2, 0] = [middle @ (np.cos(theta), np.sin(theta)) for theta in twice[:2, 1]]
    wave = search.wave.refine(search.wave.begun(Walls(np.ascontiguousarray(twice), np.ones(7))), 5)
    one = merge_walls(search, Standing(search.nothing, wave, search.explained(wave)))
    assert len(one.walls) == 6
    np.testing.assert_allclose(corners_of(one.walls.lines)[1][2:], corners_of(lines)[1][2:], atol=2e-3)


@pytest.mark.parametrize('kind', ['dart', 'u'])
def test_outlines_that_are_not_convex_are_mapped(kind):
    scene = shaped_scene(kind, 4)
    mapper = filled_mapper(scene, Parameters(), clean_echoes(scene))
    estimate = mapper.solve()
    assert estimate.status == 'closed'
    assert estimate.cautions == ()
    comparison = compare(estimate.polygon.vertices, scene.vertices)
    assert comparison.right
    assert np.abs(comparison.offsets_m).max() < 2e-4
    area = mapper.free_area.shape
    inside_start = shapely.Polygon(mapper.start_pose.inverse().apply(estimate.polygon.vertices))
    expected = area.intersection(inside_start).area / area.union(inside_start).area
    assert estimate.iou_free_area == pytest.approx(expected, abs=1e-6)


@pytest.mark.heavy
@pytest.mark.parametrize(('kind', 'seed', 'world', 'told'), [
    ('l', 4, 'mild', {'pulse_adapted'}), ('l', 4, 'typical', {'odometry_drift'}), ('t', 10, 'mild', {'pulse_adapted'})])
def test_outlines_that_are_not_convex_are_right_in_other_worlds(kind, seed, world, told):
    """Edges, device and medium as they are, or wheels that err, of which nothing is told; one wall of the T is broken
    in two on the way, by 0.06 deg."""
    trial, = ShapesExperiment((kind,), (seed,), 0.0, Parameters(), world=world).run_one(kind, seed)
    assert trial.trial.right
    assert set(trial.trial.cautions) == told
    assert max(trial.trial.offsets_m) < 2e-4


def test_where_only_convex_ones_are_asked_for_an_l_stays_open():
    scene = shaped_scene('l', 2)
    parameters = Parameters().replaced({'solver.outline': 'convex', 'slam.mode': 'off'})
    estimate = filled_mapper(scene, parameters, clean_echoes(scene)).solve()
    assert estimate.status == 'open' or estimate.cautions


def test_a_shaped_scene_is_as_said():
    for kind in SHAPE_KINDS:
        scene = shaped_scene(kind, 0)
        assert audible_feet(scene.vertices, scene.positions).sum(axis=0).min() >= 6
        convex = shapely.Polygon(scene.vertices).convex_hull.area < 1.01 * shapely.Polygon(scene.vertices).area
        assert convex == (kind == 'convex' or scene.has_inside)
        np.testing.assert_array_equal(scene.vertices, shaped_scene(kind, 0).vertices)


def test_both_tracers_give_the_same_samples():
    """Without right angles: there, images in one place count once."""
    scene = dataclasses.replace(shaped_scene('skewed_l', 0), order=3)
    own, other = noise_free(scene), clean_echoes(scene)
    assert np.sum((own - other) ** 2) < 1e-9 * np.sum(own**2)
