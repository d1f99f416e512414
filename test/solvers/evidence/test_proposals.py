"""Proposals against brute force: runs of feet, clipping against shapely, chords, and all subsets of a few lines."""

import dataclasses
import itertools

import numpy as np
import pytest
import shapely
from heard_scenes import hear, some
from references import inside

from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.outline import corners_of, half_plane_polygon
from polymap_ros.geometry.path_room import room_for_paths
from polymap_ros.geometry.paths import first_order, trace_paths
from polymap_ros.geometry.sides import outline_sides
from polymap_ros.geometry.storey import Storey
from polymap_ros.simulation.waveforms import Synthesis
from polymap_ros.solvers.evidence.proposals import (
    Candidates,
    Feet,
    _run_scores,
    chord_evidence,
    corner_cuts,
    edge_evidence,
    first_strength,
    foot_evidence,
    strongest_chords,
    strongest_lines,
)
from polymap_ros.solvers.evidence.subset import annealed_subset


def unit(theta):
    """The outward normal and, to its left, the direction along a line."""
    return np.array((np.cos(theta), np.sin(theta))), np.array((-np.sin(theta), np.cos(theta)))


def foot_sum(line, ends, positions, evidence, cell):
    """First-order evidence between two points along a line, interpolated in range; -1e9 if a foot is behind a ping."""
    normal, along = unit(line[1])
    total = 0.0
    for position, row in zip(positions, evidence, strict=True):
        if ends[0] <= position @ along <= ends[1]:
            distance = line[0] - position @ normal
            if distance <= 0.0:
                return -1e9
            if distance / cell < len(row) - 1:
                total += np.interp(distance / cell, np.arange(len(row)), row)
    return total


def test_the_evidence_of_a_foot_is_its_formula(in_pentagon):
    data = in_pentagon.data
    expected = 1.0 + np.linspace(0.5, 0.1, data.power.shape[1])[None, :]
    found = foot_evidence(data, expected, 3.0)
    for i, k in ((0, data.first_cell), (7, 100), (39, 600)):
        added = 3.0 * data.gain[i] / (k * data.cell_m)
        before, after = expected[0, k], expected[0, k] + added
        ratio = (data.power[i, k] * (1.0 - 1.0 / after) - np.log(after)) - (
            data.power[i, k] * (1.0 - 1.0 / before) - np.log(before))
        assert found[i, k] == pytest.approx(ratio)
    assert np.all(found[:, :data.first_cell] == -3.0)


def best_run(values):
    """Largest sum of a contiguous run, by trying all; 0 for none."""
    sums = np.concatenate(([0.0], np.cumsum(values)))
    return max(sums[j] - sums[i] for i in range(len(sums)) for j in range(i, len(sums)))


def test_run_scores_are_those_of_all_runs():
    generator = np.random.default_rng(0)
    positions, cell, cells = generator.uniform(-0.4, 0.6, size=(15, 2)), 0.02, 60
    evidence = generator.normal(-0.3, 1.5, size=(15, cells)).astype(np.float32)
    theta = np.linspace(-np.pi, np.pi, 24, endpoint=False) + 0.01
    along = np.array([positions @ unit(angle)[1] for angle in theta])
    scores = np.zeros((24, cells), np.float32)
    _run_scores(evidence, positions, cell, theta, np.argsort(along, axis=1), scores)
    for t, angle in enumerate(theta):
        offset = positions @ unit(angle)[0]
        for j in range(cells):
            if j * cell <= max(offset.max(), 0.0):  # a ping, or the origin, is beyond the line
                assert scores[t, j] == 0.0
                continue
            feet = j + np.floor(-offset / cell + 0.5).astype(int)
            heard = [evidence[i, feet[i]] for i in np.argsort(along[t]) if feet[i] < cells]
            assert scores[t, j] == pytest.approx(best_run(heard), abs=1e-4)


def test_the_strongest_lines_are_the_walls(pentagon):
    heard = hear(pentagon, inside(pentagon, 60), order=1)
    expected = 1.0 + np.zeros((1, heard.data.power.shape[1]))
    strength = first_strength(heard.data, expected)
    scene = heard.scene
    echo = Synthesis(make_medium(scene.medium), make_pulse(scene.pulse), 2048, scene.period_s)(np.ones(1), np.ones(1))
    energy = np.sum(echo**2) / 2.0  # after a path of twice the range
    assert 0.4 < strength / (energy / (2.0 * heard.sigma**2)) < 1.0  # lower: the lines are off by half a cell
    candidates = strongest_lines(heard.data, expected, strength, 40)
    assert np.all(np.diff(candidates.evidence) <= 0.0)
    assert len(candidates.lines) <= 40
    for r, theta in heard.lines:
        near = (np.abs(candidates.lines[:, 0] - r) < 0.01) & (
            np.abs(np.angle(np.exp(1j * (candidates.lines[:, 1] - theta)))) < 0.05)
        assert np.any(near[:12])


def half_plane(line, box):
    normal, along = unit(line[1])
    foot, far = line[0] * normal, 4.0 * box
    return shapely.Polygon([foot + far * along, foot + far * along - 2 * far * normal,
                            foot - far * along - 2 * far * normal, foot - far * along])


def edges(lines, box):
    """Where each line's edge in a box begins and ends along it, or None; None where nothing is left of the box."""
    area = shapely.box(-box, -box, box, box)
    for line in lines:
        area = area.intersection(half_plane(line, box))
    if area.area < 1e-12:
        return None
    ends = []
    for line in lines:
        normal, along = unit(line[1])
        chord = shapely.LineString([line[0] * normal + far * along for far in (-4.0 * box, 4.0 * box)])
        chord = chord.intersection(area.buffer(1e-9))
        ends.append(np.sort(shapely.get_coordinates(chord) @ along) if chord.length > 1e-6 else None)
    return ends


def test_the_evidence_of_an_edge_is_that_of_its_feet():
    generator = np.random.default_rng(3)
    positions, evidence = generator.uniform(0.0, 0.5, size=(20, 2)), generator.normal(size=(20, 100))
    for _ in range(50):
        line = np.array((generator.uniform(0.2, 1.2), generator.uniform(-np.pi, np.pi)))
        normal, _ = unit(line[1])
        ends = np.sort(generator.uniform(-0.5, 0.7, 2))
        feet = Feet(positions, np.zeros((20, 3)), evidence, 0.01)
        found = edge_evidence(line[0], *normal, *ends, feet)
        assert found == pytest.approx(foot_sum(line, ends, positions, evidence, 0.01), abs=1e-9)


def test_the_evidence_of_a_chord_is_that_of_the_line_inside(pentagon):
    generator = np.random.default_rng(4)
    positions = generator.uniform(0.4, 0.6, size=(20, 2))
    evidence = generator.normal(size=(20, 120))
    pool = np.column_stack((generator.uniform(-0.2, 1.5, 300), generator.uniform(-np.pi, np.pi, 300)))
    gains = chord_evidence(pool, polygon_lines(pentagon), Feet(positions, np.zeros((20, 3)), evidence, 0.01))
    cutting = 0
    for line, gain in zip(pool, gains, strict=True):
        normal, along = unit(line[1])
        chord = shapely.LineString([line[0] * normal - 9.0 * along, line[0] * normal + 9.0 * along]).intersection(
            shapely.Polygon(pentagon))
        if chord.length < 1e-9 or np.any(positions @ normal >= line[0]):
            assert gain == -1e9
            continue
        cutting += 1
        ends = np.sort(shapely.get_coordinates(chord) @ along)
        assert gain == pytest.approx(foot_sum(line, ends, positions, evidence, 0.01), abs=1e-9)
    assert 20 < cutting < 280


def test_a_corner_that_was_cut_off_is_proposed(pentagon):
    """The model has four of the five walls and ends in the corner of their extensions."""
    heard = hear(pentagon, inside(pentagon, 60), order=1)
    for missing in range(5):
        lines = np.delete(heard.lines, missing, 0)
        if not corners_of(lines)[0]:
            continue
        expected = np.ones((1, heard.data.power.shape[1]))
        chords = strongest_chords(heard.data, expected, first_strength(heard.data, expected), lines, 8)
        assert len(chords) <= 8
        r, theta = heard.lines[missing]
        offset = np.abs(chords[:, 0] - r)
        angle = np.abs(np.angle(np.exp(1j * (chords[:, 1] - theta))))
        assert np.any((offset < 0.006) & (angle < 0.02))


def test_nothing_cuts_a_polygon_between_the_pings(pentagon):
    """As where the odometry jumps by metres, and what was found before lies amid the places."""
    heard = hear(pentagon, inside(pentagon, 30), order=1)
    expected = np.ones((1, heard.data.power.shape[1]))
    small = heard.data.positions.mean(axis=0) + 0.02 * (pentagon - pentagon.mean(axis=0))
    assert strongest_chords(heard.data, expected, 1.0, polygon_lines(small), 8).shape == (0, 2)


def score_of(data, lines, evidence, price):
    """First-order evidence of a subset of lines on its edges, less the price."""
    def score(subset):
        ends = edges(lines[list(subset)], 2.0 * (data.range_max_m + data.extent_m))
        if ends is None:
            return -1e12
        return sum(foot_sum(lines[index], each, data.positions, evidence, data.cell_m)
                   for index, each in zip(subset, ends, strict=True) if each is not None) - price * len(subset)
    return score


def test_annealing_finds_the_best_subset_and_the_same_again(in_pentagon):
    """Nine candidates, of which all subsets are tried with brute force over their edges by shapely."""
    data = in_pentagon.data
    expected = np.ones((1, data.power.shape[1]))
    strength = first_strength(data, expected)
    candidates = strongest_lines(data, expected, strength, 9)
    evidence = foot_evidence(data, expected, strength)
    score = score_of(data, candidates.lines, evidence, 17.0)
    subsets = itertools.chain(*(itertools.combinations(range(9), size) for size in range(1, 7)))
    best = max(subsets, key=score)
    chosen = [annealed_subset(data, candidates, evidence, 17.0, 6, 5000, np.random.default_rng(seed))
              for seed in (1, 1, 2)]
    np.testing.assert_array_equal(chosen[0], chosen[1])
    for each in chosen:
        assert sorted(each) == list(best)


@pytest.mark.parametrize(('steps', 'most'), [(40, 6), (80, 3), (150, 5)])
def test_every_decision_of_the_annealing_is_that_of_an_oracle(steps, most, in_pentagon):
    """Which replays its random numbers: a line, one of add, drop and exchange, a slot, and the acceptance."""
    data = some(in_pentagon.data, np.arange(0, 40, 3))
    expected = np.ones((1, data.power.shape[1]))
    candidates = strongest_lines(data, expected, 100.0, 12)
    evidence = foot_evidence(data, expected, 100.0)
    score = score_of(data, candidates.lines, evidence, 17.0)
    chances = np.cumsum(np.sqrt(candidates.evidence)) / np.sum(np.sqrt(candidates.evidence))
    chosen, value, best, best_value = [], 0.0, [], 0.0
    for step, (u_line, u_move, u_slot, u_accept) in enumerate(np.random.default_rng(1).random((steps, 4))):
        line, slot, trial = int(np.sum(chances < u_line)), int(u_slot * len(chosen)), list(chosen)
        if u_move < 0.35 and len(chosen) < most and line not in chosen:
            trial.append(line)
        elif 0.35 <= u_move < 0.6 and chosen:
            trial[slot] = trial[-1]
            trial.pop()
        elif u_move >= 0.6 and chosen and line not in chosen:
            trial[slot] = line
        else:
            continue
        changed, temperature = score(trial), 30.0 ** (1.0 - step / steps)
        if u_accept < np.exp(min(changed - value, 0.0) / temperature):
            chosen, value = trial, changed
            if value > best_value:
                best, best_value = chosen, value
    assert len(best) > 2
    found = annealed_subset(data, candidates, evidence, 17.0, most, steps, np.random.default_rng(1))
    assert found.tolist() == best


def test_annealing_keeps_to_the_largest_number_and_to_nothing(in_pentagon):
    data = in_pentagon.data
    evidence = foot_evidence(data, np.ones((1, data.power.shape[1])), 100.0)
    candidates = strongest_lines(data, np.ones((1, data.power.shape[1])), 100.0, 50)
    few = annealed_subset(data, candidates, evidence, 17.0, 3, 5000, np.random.default_rng(1))
    assert len(few) == len(set(few.tolist())) == 3
    none = annealed_subset(data, candidates, evidence, 1e9, 10, 5000, np.random.default_rng(1))
    assert len(none) == 0
    empty = Candidates(np.empty((0, 2)), np.empty(0))
    assert len(annealed_subset(data, empty, evidence, 17.0, 10, 100, np.random.default_rng(1))) == 0


def test_noise_alone_proposes_little(in_pentagon):
    generator = np.random.default_rng(6)
    data = dataclasses.replace(in_pentagon.data, power=generator.exponential(size=in_pentagon.data.power.shape))
    expected = np.ones((1, data.power.shape[1]))
    loud = strongest_lines(in_pentagon.data, expected, 30.0, 5).evidence
    assert strongest_lines(data, expected, 30.0, 5).evidence.max(initial=0.0) < 0.1 * loud.min()


def test_corners_are_cut_off_by_edges_of_the_lengths_asked_for():
    lines = polygon_lines([(0.0, 0.0), (1.0, 0.0), (1.3, 0.7), (0.6, 1.2), (-0.2, 0.6)])
    lines = lines[np.argsort(lines[:, 1])]
    corners, which = half_plane_polygon(lines)
    corners = corners[[list(which).index(k) for k in range(5)]]  # corner i between walls i - 1 and i
    cuts = corner_cuts(lines[:, 1], corners, (0.02, 0.05))
    lengths = []
    for cut in cuts:
        vertices, edges = half_plane_polygon(np.vstack((lines, cut)))
        assert len(edges) == 6
        at = list(edges).index(5)
        lengths.append(np.linalg.norm(vertices[(at + 1) % 6] - vertices[at]))
    np.testing.assert_allclose(np.sort(lengths), 15 * [0.02] + 15 * [0.05], rtol=1e-9)


def test_first_echoes_of_emitter_and_receiver_apart_are_those_of_the_traced_paths(pentagon):
    """A line's evidence is gathered where its paths of one reflection are, by length and by the place of reflection."""
    positions, generator = inside(pentagon, 12), np.random.default_rng(5)
    baselines = np.column_stack((generator.uniform(-0.1, 0.1, (12, 2)), np.full(12, 0.07)))
    sides = outline_sides(pentagon, 0.0, True)
    paths, compared = room_for_paths(1), 0
    for position, baseline in zip(positions, baselines, strict=True):
        ends = np.concatenate((position - 0.5 * baseline[:2], position + 0.5 * baseline[:2], baseline[2:]))
        heard = {int(paths.walls[m, 0]): paths.half[m]
                 for m in range(trace_paths(sides, ends, 1, 9.0, 0.0, False, Storey().images(1), paths))}
        for wall, (c, s, r, start, end) in enumerate(sides.rows[:, :5]):
            half, along = first_order(r, c, s, *position, *baseline)
            assert (start <= along <= end) == (wall in heard)
            if wall in heard:
                assert half == pytest.approx(heard[wall], abs=1e-12)
                compared += 1
            # One ping whose evidence is its range in cells, which is what the edge gets.
            feet = Feet(position[None], baseline[None], np.arange(300.0)[None], 0.01)
            found = edge_evidence(r, c, s, start, end, feet)
            assert found == pytest.approx(heard.get(wall, 0.0) / 0.01, abs=1e-9)
    assert compared > 20


def test_no_ping_brings_more_than_its_limits(pentagon):
    heard = hear(pentagon, inside(pentagon, 6))
    data, nothing = heard.data, np.ones_like(heard.data.power)
    free = foot_evidence(data, nothing, 10.0)
    limited = foot_evidence(dataclasses.replace(data, foot_limits=(-2.0, 8.0)), nothing, 10.0)
    assert free.min() < -2.0
    assert free.max() > 8.0
    np.testing.assert_array_equal(limited[:, data.first_cell:], np.clip(free, -2.0, 8.0)[:, data.first_cell:])
