"""What stands inside an outline: holes and inner walls as unknowns, how they are found, and what they are not."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper, judged
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.geometry.lines import moved_lines, polygon_lines, wrapped
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.sides import Interior
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.shaped_scenes import shaped_scene
from polymap_ros.solvers.evidence.answer import _names
from polymap_ros.solvers.evidence.certainty import certainty_of
from polymap_ros.solvers.evidence.likelihood import Slopes
from polymap_ros.solvers.evidence.moves.hole import with_hole
from polymap_ros.solvers.evidence.moves.inner_wall import _add_runs, add_inner_wall
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.square_walls import SquareWalls, free, tied_hole
from polymap_ros.solvers.evidence.walls import Walls

SQUARE = np.array([[0.0, 0.0], [1.2, 0.0], [1.2, 1.0], [0.0, 1.0]])
HOLE = np.array([[0.4, 0.3], [0.4, 0.6], [0.8, 0.6], [0.8, 0.3]])  # clockwise
SEAM, SPAN = np.array((0.95, 0.1)), np.array((-0.3, 0.6, 0.9))


def furnished():
    """A square with a hole and an inner wall."""
    return Walls(polygon_lines(SQUARE), np.linspace(0.9, 1.0, 4)).with_inner(SEAM, SPAN, 0.4).with_hole(
        polygon_lines(HOLE))


def rows(walls):
    bound, sides = walls.sides(0.0, 0.01)
    assert bound
    return sides.rows


def test_holes_come_before_inner_walls_and_neither_is_of_the_outline():
    walls = furnished()
    assert (len(walls), walls.ring) == (9, 4)
    np.testing.assert_array_equal(walls.outline, polygon_lines(SQUARE))
    np.testing.assert_array_equal(walls.lines[8], SEAM)
    assert walls.reflection[8] == 0.4
    assert not walls.convex_outline
    assert len(rows(walls)) == 10  # both sides of the inner wall


def test_without_a_wall_the_rest_stays_what_it_is():
    walls = furnished()
    assert walls.without(0).ring == 3
    assert walls.without(8).interior.spans.shape == (0, 3)
    assert not walls.without(5).without(5).sides(0.0, 0.01)[0]  # two walls bound no hole
    unpierced = walls.without_hole(0)
    assert (unpierced.ring, len(unpierced), len(unpierced.interior.holes)) == (4, 5, 0)
    np.testing.assert_array_equal(unpierced.lines[4], SEAM)
    cut = walls.inserted(1, np.array((1.35, -0.7)), 0.0)
    assert (cut.ring, len(cut.interior.holes), len(cut.interior.spans)) == (5, 1, 1)
    other = walls.with_outline(polygon_lines(SQUARE + 0.05), np.ones(4))
    np.testing.assert_array_equal(other.lines[4:], walls.lines[4:])


def test_seen_from_another_frame_all_ends_are_where_they_were():
    walls, frame = furnished(), Pose(0.3, -0.7, 2.1)
    moved = rows(walls.seen_from(frame))
    for ends in (slice(5, 7), slice(7, 9)):
        np.testing.assert_allclose(moved[:, ends], frame.apply(rows(walls)[:, ends]), atol=1e-12)


def test_what_reflects_nearly_all_is_no_inner_wall():
    walls = furnished()
    assert walls.let_through
    assert not dataclasses.replace(walls, reflection=np.append(walls.reflection[:8], -0.9)).let_through


def test_an_unsure_wall_is_told_by_its_name():
    _, search, found, _ = searching('seam', 2)
    wave = add_inner_wall(search, Standing(found.power, found.wave, found.explained))
    certainty = certainty_of(search, search.judged(found.power, wave))
    assert certainty.likelihood.min() > 0.9
    assert certainty.unsupported == 0
    assert _names(furnished()) == ['0', '1', '2', '3', 'H0.0', 'H0.1', 'H0.2', 'H0.3', 'W0']


def test_walls_of_a_hole_turn_together_until_they_are_free():
    walls = tied_hole(Walls(polygon_lines(SQUARE), np.ones(4)), polygon_lines(HOLE))
    assert isinstance(walls, SquareWalls)
    step = np.zeros(len(walls.gradient(_no_slopes(8))))
    step[8 + 4] = 0.01  # r of all walls, the turns of four walls, then that of the hole
    turned = walls.moved(step).lines - walls.lines
    np.testing.assert_allclose(turned[:, 1], np.repeat((0.0, 0.01), 4))
    other = walls.with_outline(polygon_lines(SQUARE + 0.05), np.ones(4))
    assert isinstance(other, SquareWalls)
    assert len(set(other.group.tolist())) == 5
    assert type(free(walls)) is Walls
    assert free(walls).interior is walls.interior


def _no_slopes(count):
    size = 3 * count
    return Slopes(np.zeros((1, size)), np.zeros((1, size, size)), np.empty((1, size, 0)), np.empty((1, 0, 0)))


def searching(kind, seed):
    """A search over a scene, what it finds as its outline, and the scene's frame."""
    scene = shaped_scene(kind, seed)
    mapper = filled_mapper(scene, Parameters())
    search = search_of(mapper.evidence, Parameters())
    corners = mapper.start_pose.inverse().apply(scene.vertices)
    power = search.nothing.with_strength(1.0).with_walls(Walls.of_polygon(corners))
    return scene, search, search.settle(search.power.refine(power.walls, power, 2)), mapper.start_pose.inverse()


@pytest.mark.parametrize('kind', ['seam', 'stiffener'])
def test_an_inner_wall_is_what_the_waveform_leaves(kind):
    scene, search, found, frame = searching(kind, 2)
    assert found.explained < 0.95
    wave = add_inner_wall(search, Standing(found.power, found.wave, found.explained))
    (true,) = scene.inner_walls
    r, theta = moved_lines(polygon_lines([true.start, true.end])[:1], frame)[0]
    heard = wave.walls.lines[-1]
    turned = np.cos(heard[1] - theta) < 0.0
    assert abs(heard[0] - (-r if turned else r)) < 1e-3
    assert abs(wrapped(heard[1] - theta - np.pi * turned)) < 3e-3
    assert abs(wave.walls.reflection[-1]) == pytest.approx(true.reflection, abs=0.03)
    assert wave.walls.interior.spans[0, 2] == pytest.approx(np.sqrt(1.0 - true.reflection**2), abs=0.05)
    assert search.explained(wave) > 0.99


def test_where_all_is_explained_or_nothing_no_inner_wall_is_looked_for():
    _, search, found, _ = searching('seam', 2)
    assert add_inner_wall(search, Standing(found.power, found.wave, 0.3)) is None
    full = dataclasses.replace(found.wave, walls=dataclasses.replace(
        found.walls, interior=Interior(np.empty(0, np.int64), np.zeros((3, 3)))))
    assert add_inner_wall(search, Standing(found.power, full, 0.7)) is None


def test_a_hole_is_found_by_power_and_settled_by_the_waveform():
    scene, search, found, frame = searching('hole', 2)
    power, true = with_hole(search, found.power), moved_lines(polygon_lines(scene.holes[0].vertices), frame)
    settled = search.settle(power)
    for within, walls in ((0.02, power.walls), (1e-3, settled.walls)):
        hole = walls.lines[walls.ring:]
        off = np.abs(hole[:, None, 0] - true[None, :, 0]) + np.abs(wrapped(hole[:, None, 1] - true[None, :, 1]))
        assert np.all(off.min(axis=1) < within)
    assert found.explained < 0.7  # by power alone
    assert settled.explained > 0.99


def test_between_emitter_and_receiver_the_foot_is_where_the_echo_is_reflected():
    """The runs of a line are gathered at half the way over it, on either side of it."""
    places, apart = np.array([(-0.5, 0.1), (0.6, -0.2), (0.7, 0.3)]), np.array([(0.1, 0.2, 0.05)] * 3)
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    x = np.zeros((3, 2000), np.float32)
    for ping, (place, way) in enumerate(zip(places, apart, strict=True)):  # of the line x = 0.1, by the image source
        emitter, receiver = place - 0.5 * way[:2], place + 0.5 * way[:2]
        half = 0.5 * np.hypot(np.hypot(0.2 - emitter[0] - receiver[0], receiver[1] - emitter[1]), way[2])
        x[ping, round(half / 1e-3)] = 1.0
    runs = np.zeros((1, 4, 6))
    _add_runs(x, np.full(2000, 1e-9), 1e-3, np.ones(3), places, apart, corners, np.zeros(1), np.array([[1, 0, 2]]), 1.0,
              0.05, 0.0, 0.05, runs)
    best = runs[0, np.argmax(runs[0, :, 0])]
    assert best[0] == pytest.approx(3 * 0.3, abs=1e-6)
    assert best[1] == pytest.approx(0.1)


@pytest.mark.heavy
@pytest.mark.parametrize('kind', ['seam', 'stiffener', 'hole', 'two_holes'])
def test_plates_with_something_inside_are_right_and_not_doubted(kind):
    scene = shaped_scene(kind, 4)
    estimate = filled_mapper(scene, Parameters()).solve()
    trial = judged(estimate, scene, 'evidence', 0.0)
    assert trial.right
    assert trial.cautions == ()
    assert len(estimate.holes) == len(scene.holes)
    assert len(estimate.inner_walls) == len(scene.inner_walls)
    for wall, true in zip(estimate.inner_walls, scene.inner_walls, strict=True):
        assert abs(wall.reflection) == pytest.approx(true.reflection, abs=0.05)
        assert wall.edge.likelihood > 0.9


@pytest.mark.parametrize('seed', [4, 8])
def test_a_faint_wall_of_the_outline_is_no_inner_wall(seed):
    """The other three of a quadrangle meet far away, by themselves or with a wall that is not there."""
    scene = VARIANTS['damped_0.2'].make(seed, 4)
    mapper = filled_mapper(scene, Parameters())
    estimate = mapper.solve()
    assert (estimate.status, estimate.cautions, estimate.inner_walls) == ('closed', (), ())
    assert compare(estimate.polygon.vertices, scene.vertices).right
