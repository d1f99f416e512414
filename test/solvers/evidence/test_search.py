"""The search's steps on their own: smooth likelihoods, signs, shortest edges, walls exchanged, what is explained."""

import dataclasses

import numpy as np
import pytest
from heard_scenes import hear
from references import inside

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.geometry.lines import polygon_lines, wrapped
from polymap_ros.geometry.outline import bounding_lines, corners_of, half_plane_polygon
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import Parameters, SensorParameters
from polymap_ros.simulation.doubtful_scenes import KINDS
from polymap_ros.simulation.random_scenes import Recipe, random_scene
from polymap_ros.solvers.evidence import data as data_module
from polymap_ros.solvers.evidence.answer import CERTAIN
from polymap_ros.solvers.evidence.certainty import certainty_of
from polymap_ros.solvers.evidence.likelihood import Slopes
from polymap_ros.solvers.evidence.moves.corner_cut import slid
from polymap_ros.solvers.evidence.moves.exchange import improved
from polymap_ros.solvers.evidence.moves.faint import hear_faint
from polymap_ros.solvers.evidence.moves.residual import add_from_residual
from polymap_ros.solvers.evidence.moves.scan import scanned
from polymap_ros.solvers.evidence.moves.slip import slipped
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.moves.start import starts
from polymap_ros.solvers.evidence.moves.wall_drop import drop_wall
from polymap_ros.solvers.evidence.power import Power, PowerLikelihood
from polymap_ros.solvers.evidence.proposals import corner_cuts
from polymap_ros.solvers.evidence.search import Search, search_of
from polymap_ros.solvers.evidence.tuning import EXPLAINED, FULL_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood


def in_room(scene, clean=None):
    """A search over what a scene's pings hear, and the true lines in its frame, sorted by theta."""
    mapper = filled_mapper(scene, Parameters(), clean)
    lines = polygon_lines(Pose(*scene.poses[0]).inverse().apply(scene.vertices))
    return search_of(mapper.evidence, mapper.parameters), lines[np.argsort(lines[:, 1])]


def judged(search, lines):
    """The polygon of these lines, refined from there."""
    refined = search.power.refine(Walls.convex(lines), search.power.initial(1.0), 5, 6)
    return None if refined is None else search.judge(refined)


def at(search, lines, reflection, phase, order=5):
    """The waveform of walls, from a phase of the device."""
    walls = Walls.convex(lines, reflection)
    return search.wave.evaluate(walls, Wave(walls, phase, np.nan, np.empty(0)), order)


def standing(search, found, wave=None):
    """What the moves of a waveform start from."""
    wave = wave or found.wave
    return Standing(found.power, wave, search.explained(wave))


@pytest.fixture(scope='module')
def nearby(pentagon):
    return hear(pentagon, inside(pentagon, 12), order=3, seed=3)


def largest_steps(value, lines, wall):
    """Largest change of a likelihood as a wall moves out through 4 mm, in steps of 40 and of 10 micrometres."""
    values = []
    for shift in np.arange(-2e-3, 2e-3, 1e-5):
        moved = lines.copy()
        moved[wall, 0] += shift
        values.append(value(moved))
    return np.abs(np.diff(values[::4])).max(), np.abs(np.diff(values)).max()


@pytest.mark.parametrize('kind', ['power', 'waveform'])
def test_likelihoods_do_not_jump_where_a_path_passes_a_walls_end(kind, nearby, monkeypatch):
    """A quarter of the step changes a smooth likelihood by a quarter; with hard ends some changes stay as large."""
    nothing = np.zeros(nearby.data.power.shape[1])

    def value(lines):
        if kind == 'power':
            like = Power(Walls.convex(lines), 3.0, nothing, np.nan, nothing)
            return PowerLikelihood(nearby.data).value(like.walls, like, 3)
        walls = Walls.convex(lines, nearby.reflection)
        return WaveformLikelihood(nearby.data).evaluate(walls, Wave(walls, 0.0, np.nan, nothing), 3).value

    smooth = [largest_steps(value, nearby.lines, wall) for wall in range(5)]
    assert all(fine < 0.3 * coarse for coarse, fine in smooth)
    monkeypatch.setattr(data_module, '_SOFT', 1e-7)
    assert max(fine / coarse for coarse, fine in (largest_steps(value, nearby.lines, wall) for wall in range(5))) > 0.5


@pytest.mark.parametrize('turned', [False, True])
@pytest.mark.parametrize('negative', [(), (0, 2, 3), (0, 1, 2, 3), (0, 1, 2, 3, 4)])
def test_rooms_that_differ_in_all_signs_are_told_apart(negative, turned, pentagon):
    """By their echoes of even order; odd ones are the same with a device turned by pi."""
    reflection = np.array([0.9, 0.7, 1.0, 0.8, 0.6])
    reflection[list(negative)] *= -1.0
    heard = hear(pentagon, inside(pentagon, 30), reflection=reflection, seed=6)
    if turned:
        heard = dataclasses.replace(heard, data=dataclasses.replace(heard.data, signal=-heard.data.signal))
    search = Search(heard.data, 10, np.random.default_rng(1))
    wave = judged(search, heard.lines).wave
    np.testing.assert_array_equal(np.sign(wave.walls.reflection), np.sign(heard.reflection))
    np.testing.assert_allclose(wave.walls.reflection, heard.reflection, atol=0.05)
    assert np.abs(np.angle(np.exp(1j * (wave.phase - np.pi * turned)))) < 0.05
    other = search.wave.refine(wave.turned(), 5)
    assert other.value < wave.value - 100.0


def test_active_lines_have_no_edge_of_the_shortest_length_or_below():
    """Random lines, many of which cut off slivers; what is left is the half-planes' polygon without their lines."""
    generator, slivers = np.random.default_rng(2), 0
    for _ in range(300):
        n = generator.integers(3, 9)
        lines = np.column_stack((generator.uniform(0.7, 1.0, n), generator.uniform(-np.pi, np.pi, n)))
        whole = bounding_lines(lines, 0.0)
        kept = bounding_lines(lines, 0.1)
        slivers += len(kept) < len(whole)
        if len(kept) == 0:
            continue
        assert {tuple(line) for line in kept} <= {tuple(line) for line in whole}
        vertices, which = half_plane_polygon(kept)
        assert len(which) == len(kept)
        if np.abs(vertices).max() > 100.0:  # of a size at which 0.1 m is nothing
            continue
        assert np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1).min() > 0.1
        assert corners_of(kept, 0.1)[0]
    assert slivers > 20


def test_a_wall_in_the_wrong_place_is_exchanged_for_the_right_one():
    """At -10 dB, by trying all lines in the place of one edge."""
    search, truth = in_room(dataclasses.replace(random_scene(36, 7), snr_db=-10.0))
    right = judged(search, truth)
    np.testing.assert_allclose(right.lines, truth, atol=1e-3)
    moved = truth.copy()
    moved[1] += (0.03, 0.1)
    wrong = judged(search, moved)
    assert abs(wrong.lines[1, 0] - truth[1, 0]) > 0.01
    assert wrong.value < right.value - 1000.0
    assert wrong.explained < EXPLAINED - search.uncertainty
    mended = search.mended(wrong)
    np.testing.assert_allclose(mended.lines, right.lines, atol=1e-4)  # where half a nat is all that it matters
    assert mended.value > right.value - 0.5


@pytest.mark.parametrize('cycles', [-1.0, -0.5, 0.5, 1.0])
def test_a_wall_that_is_cycles_off_is_put_back(cycles):
    """Of range; half a cycle turns the sign."""
    search, truth = in_room(random_scene(120, 5))
    right = judged(search, truth).wave
    lines, reflection = right.walls.lines.copy(), right.walls.reflection.copy()
    lines[2, 0] += cycles * np.pi / search.data.pulse.carrier
    reflection[2] *= np.cos(2.0 * np.pi * cycles)
    off = at(search, lines, reflection, right.phase)
    assert off.value < right.value - 100.0
    back = slipped(search, off, np.array([2]))
    np.testing.assert_allclose(back.walls.lines, right.walls.lines, atol=1e-4)
    assert slipped(search, right, np.arange(5)) is None


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_line_across_a_corner_slides_to_where_its_edge_is(sign):
    """By up to a cycle of range, with the sign that the echoes have."""
    room = np.array([(0.0, 0.0), (1.2, 0.0), (1.2, 0.72), (1.14, 0.8), (0.0, 0.8)])
    reflection = np.array([1.0, 1.0, sign, 1.0, 1.0])
    heard = hear(room, inside(room, 40), snr_db=10.0, reflection=reflection)
    search = Search(heard.data, 10, np.random.default_rng(1))
    across = int(np.argmin(np.abs(heard.lines[:, 1] - np.arctan2(0.06, 0.08))))
    others = at(search, np.delete(heard.lines, across, 0), np.delete(heard.reflection, across), 0.0)
    others = search.wave.refine(others, 5)
    cycle = np.pi / search.data.pulse.carrier
    found = slid(search, others, heard.lines[across] + (0.6 * cycle, 0.0)).walls
    assert found.lines[across, 0] == pytest.approx(heard.lines[across, 0], abs=0.11 * cycle)
    assert found.reflection[across] == sign


def test_as_many_edges_as_are_allowed_are_found_by_power_and_no_more():
    search, truth = in_room(random_scene(120, 5))
    for most in (4, 5):
        limited = Search(search.data, most, np.random.default_rng(1))
        first = limited.power.refine(Walls.convex(np.delete(truth, [0], 0)), limited.power.initial(1.0), 2, 6)
        found = improved(limited, first, 3, np.empty((0, 2)), residual=True)
        assert len(found.walls) == most
    np.testing.assert_allclose(found.walls.lines, truth, atol=5e-3)


def test_two_lines_that_change_places_leave_no_corner_that_points_inwards():
    """Two lines that this hexagon is tried with cross as they are refined; the moves of an outline with eight edges,
    one corner of which pointed inwards, took 43 s to mend it.
    """
    search, lines = in_room(random_scene(6, 6))
    found = search.by_power(next(starts(search))).walls
    assert found.convex_outline
    np.testing.assert_allclose(found.lines, lines, atol=8e-3)  # power alone


@pytest.mark.parametrize('turn', [1e-4, 5e-4, 1e-3])
def test_a_wall_that_is_given_twice_comes_out_once(turn):
    """What the second one explains of the little that no polygon does is more than an edge's price here."""
    search, truth = in_room(random_scene(295, 6))
    corners = corners_of(truth)[1]
    middle, angles = (corners[5] + corners[0]) / 2.0, truth[5, 1] + np.array([-turn, turn])
    twice = np.column_stack((np.cos(angles) * middle[0] + np.sin(angles) * middle[1], angles))
    walls = Walls.convex(np.vstack((truth[:5], twice)))
    found = search.settle(search.power.refine(walls, search.power.initial(1.0), 5, 6))
    np.testing.assert_allclose(found.lines, truth, atol=1e-3)
    assert found.explained > EXPLAINED


@pytest.mark.parametrize(('seed', 'edges'), [(0, 4), (1, 5), (2, 6), (3, 4)])
def test_right_angled_rooms_are_explained(seed, edges):
    """Where two images of a corner stand in one place, they count as one."""
    search, truth = in_room(random_scene(seed, edges, Recipe('right_angled')))
    found = judged(search, truth)
    np.testing.assert_allclose(found.lines, truth, atol=1e-3)
    assert found.explained > 0.98


def test_power_explains_less_without_a_wall():
    search, truth = in_room(random_scene(120, 5))
    search.coherent = False
    assert 0.95 < judged(search, truth).explained <= 1.0
    fewer = [judged(search, np.delete(truth, wall, 0)) for wall in range(5)]
    shares = [found.explained for found in fewer if found is not None]
    assert len(shares) > 1
    assert max(shares) < 0.9


@pytest.mark.parametrize(('seed', 'edges'), [(0, 3), (1, 4), (2, 5), (3, 6)])
def test_a_second_mode_is_not_explained(seed, edges):
    doubtful = KINDS['mode_-10db'].make(seed, edges)
    search, truth = in_room(doubtful.scene, doubtful.clean)
    found = judged(search, truth)
    np.testing.assert_allclose(found.lines, truth, atol=2e-3)
    assert 0.85 < found.explained < EXPLAINED - search.uncertainty


def test_without_phase_no_edge_is_certain_that_should_have_one():
    """Walls are worth as many nats by power alone, whether the echoes carry a phase that disagrees or none."""
    search, truth = in_room(random_scene(120, 5))
    found = judged(search, truth)
    assert np.all(certainty_of(search, found).likelihood > 0.99)
    by_power = found._replace(wave=None)
    assert np.all(certainty_of(search, by_power).likelihood < CERTAIN)
    search.coherent = False  # magnitudes
    assert np.all(certainty_of(search, by_power).likelihood > 0.99)


def test_an_edge_whose_r_is_vague_is_not_certain():
    """The same waveform, as if its echoes told a millionth of what they do about one wall."""
    search, truth = in_room(random_scene(120, 5))
    found = judged(search, truth)
    share, slopes = np.where(np.arange(15) % 5 == 2, 1e-3, 1.0), found.wave.slopes
    vague = found._replace(wave=found.wave.with_slopes(Slopes(
        slopes.scores * share, slopes.information * np.outer(share, share), slopes.by_phase * share[:, None],
        slopes.phase)))
    sure = certainty_of(search, vague)
    assert np.sqrt(sure.covariance[4, 4]) > search.data.pulse.width_m / 2.0
    np.testing.assert_array_equal(sure.likelihood < CERTAIN, np.arange(5) == 2)


@pytest.fixture(scope='module')
def in_triangle(triangle):
    """A search over twelve pings, and the lines of a polygon that lacks the wall at the bottom."""
    heard = hear(triangle, inside(triangle, 12), order=3, seed=3)
    search = Search(heard.data, 10, np.random.default_rng(1))
    far = np.array([(0.5, -np.pi / 2.0)])
    bottom = int(np.argmin(np.abs(heard.lines[:, 1] + np.pi / 2.0)))
    lines = np.vstack((np.delete(heard.lines, bottom, 0), far))
    base = search.power.fitted(Walls.convex(lines), search.power.initial(1.0), 3)
    return search, base, heard.lines[bottom]


def test_all_lines_are_tried_a_width_and_a_quarter_apart_and_the_best_are_apart(in_triangle):
    """Against every line of the grid that leaves all pings on one side, each judged on its own."""
    search, base, missing = in_triangle
    found = scanned(search, base)
    width = 1.25 * search.data.pulse.width_m
    turn = 2.0 * width / search.data.extent_m
    corners, values = corners_of(base.walls.lines)[1], {}
    for theta in np.arange(-np.pi, np.pi, turn):
        normal = np.array([np.cos(theta), np.sin(theta)])
        nearest = (search.data.positions @ normal).max()
        farthest = min((corners @ normal).max(), nearest + search.data.range_max_m / 2.0)
        for r in np.arange(nearest + width / 2.0, farthest, width):
            lines = bounding_lines(np.vstack((base.walls.lines, (r, theta))), search.data.shortest_m)
            if len(lines):
                reflection = [dict(zip(base.walls.lines[:, 0], base.walls.reflection, strict=True)).get(q, 1.0)
                              for q in lines[:, 0]]
                values[r, theta] = search.power.value(Walls.convex(lines, reflection), base, 2)
    assert np.hypot(*((found[0] - missing) / (width, turn))) < 1.0

    def near(line, other):
        return abs(line[0] - other[0]) <= 2.5 * width and abs(np.angle(np.exp(1j * (line[1] - other[1])))) <= 2.5 * turn

    left = dict(values)
    for line in found.tolist():
        best = max(left, key=left.get)
        assert tuple(line) == pytest.approx(best, abs=1e-12)
        left = {other: value for other, value in left.items() if not near(other, line)}
    assert len(found) == 12


@pytest.mark.parametrize('wall', range(5))
def test_a_wall_that_is_missing_is_added_and_nothing_else(wall, in_pentagon):
    search = Search(in_pentagon.data, 6, np.random.default_rng(1))
    right = judged(search, in_pentagon.lines)
    assert add_from_residual(search, standing(search, right)) is None
    fewer = search.wave.refine(right.wave.with_walls(right.walls.without(wall)), 5)
    added = add_from_residual(search, standing(search, right, fewer)).walls
    np.testing.assert_allclose(added.lines, right.lines, atol=1e-4)
    np.testing.assert_allclose(added.reflection, right.walls.reflection, atol=1e-2)
    search.max_edges = 4
    assert add_from_residual(search, standing(search, right, fewer)) is None


def test_two_edges_that_are_none_are_dropped_one_by_one_and_no_wall(in_pentagon):
    search = Search(in_pentagon.data, 10, np.random.default_rng(1))
    right = judged(search, in_pentagon.lines)
    assert drop_wall(search, standing(search, right)) is None
    corners = corners_of(right.lines)[1]
    cuts = corner_cuts(right.lines[:, 1], corners, [0.04])
    lines, reflection = np.vstack((right.lines, cuts[0], cuts[3])), np.append(right.walls.reflection, (0.3, 0.9))
    wrong = at(search, lines, reflection, right.wave.phase)
    once = drop_wall(search, standing(search, right, wrong))
    assert len(once.walls) == 6
    twice = drop_wall(search, standing(search, right, once))
    np.testing.assert_allclose(twice.walls.lines, right.lines, atol=1e-4)


@pytest.mark.parametrize(('seed', 'in_phase'), [(1, True), (2, True), (7, True), (8, False), (9, False)])
def test_where_positions_are_off_power_has_the_last_word_unless_phases_agree_by_half(
        seed, in_phase, pentagon):
    """Errors of 3 mm, a seventh of a wavelength: at the true walls phases agree by half, or by a tenth and less."""
    heard = hear(pentagon, inside(pentagon, 20), snr_db=10.0, seed=3)
    off = np.random.default_rng(seed).normal(0.0, 3e-3, heard.data.positions.shape)
    search = Search(dataclasses.replace(heard.data, positions=heard.data.positions + off), 10, np.random.default_rng(1))
    walls = Walls.convex(heard.lines)
    true = search.wave.refine(search.wave.begun(walls), FULL_ORDER)
    assert (search.explained(true) > 0.45, search.explained(true) > 0.1) == (in_phase, in_phase)
    found = search.settle(search.power.initial(1.0).with_walls(walls))
    assert (found.wave is not None) == in_phase
    np.testing.assert_allclose(found.lines, heard.lines, atol=8e-3)


@pytest.mark.parametrize('apart_m', [0.0, 0.05])
def test_a_wall_that_reflects_a_fifth_is_heard_in_phase_in_the_place_of_a_silent_one(apart_m):
    """The silent wall is at the neighbour's side, where it takes a few of its echoes; the faint one 30 degrees on."""
    sensor = SensorParameters(baseline_x_m=apart_m)
    scene = dataclasses.replace(VARIANTS['damped_0.2'].make(2, 6), sensor=sensor)
    search, lines = in_room(scene)
    faint = int(np.argmin(np.abs(wrapped(lines[:, 1] + 2.734))))
    beside = lines.copy()
    beside[faint] = lines[(faint + 1) % 6] + (0.012, -0.11)
    reflection = np.ones(6)
    reflection[faint] = 0.05
    power = search.nothing.with_strength(1.0).with_walls(Walls(beside, reflection))
    wave = search.wave.refine(search.wave.begun(power.walls), 5)
    assert np.argmin(np.abs(wave.walls.reflection)) == faint
    better = hear_faint(search, Standing(power, wave, search.explained(wave)))
    assert better.walls.lines[faint] == pytest.approx(lines[faint], abs=1e-3)
    assert better.walls.reflection[faint] == pytest.approx(0.2, abs=0.02)
    assert hear_faint(search, Standing(power, better, 1.0)) is None
