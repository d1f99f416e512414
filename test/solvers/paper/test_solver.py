"""The published optimiser against an oracle in plain numpy and shapely that replays its random numbers."""

import dataclasses

import numpy as np
import pytest
import shapely
from references import bounded_area

from polymap_ros.geometry.overlap import Region
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.maps.free_area import FreeArea
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.paper.annealing import Landscape, cost_of
from polymap_ros.solvers.paper.solver import PaperSolver, filtered
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.solver import Evidence


class Oracle:
    """Eqs. (5)-(10) line by line, without any of the package's geometry; slow."""

    def __init__(self, likelihood, r_m, theta_deg, circle, free, area_of, parameters):
        self.likelihood, self.r_m, self.theta_deg, self.circle = likelihood.astype(float), r_m, theta_deg, circle
        self.free, self.area_of, self.solver = free, area_of, parameters.solver
        self.reach_m = 0.5 * parameters.grid.range_max_m / 3.0
        self.random = np.random.default_rng(self.solver.seed)
        first = self.random.random((self.solver.max_edges, 2)) * (len(r_m), len(theta_deg))
        self.lines = [(int(r), int(theta)) for r, theta in first]
        self.cost = self.cost_of(self.lines)

    def polygon(self, lines):
        return self.area_of(np.array([(self.r_m[i], np.deg2rad(self.theta_deg[j])) for i, j in lines]))

    def iou(self, lines):
        polygon = self.polygon(lines)
        if polygon.is_empty:
            return 0.0
        return polygon.intersection(self.free).area / polygon.union(self.free).area

    def cost_of(self, lines):
        return -(sum(self.likelihood[j, i] for i, j in lines) + self.solver.iou_weight * self.iou(lines))

    def neighbour(self, line, chi_r, chi_theta):
        r = max(self.r_m[line[0]] + self.reach_m * chi_r**3, 0.0)  # eq. (7)
        r = min(r, self.r_m[-1])
        theta = self.theta_deg[line[1]] + 180.0 * chi_theta**3
        if self.circle:
            turn = np.mod(self.theta_deg - theta + 180.0, 360.0) - 180.0
        else:
            turn = self.theta_deg - np.clip(theta, self.theta_deg[0], self.theta_deg[-1])
        away_r, away_theta = np.abs(self.r_m - r), np.abs(turn)
        near_r = away_r <= max(self.solver.neighbourhood_m / 2.0, away_r.min())  # the nearest cell if V has none
        near_theta = away_theta <= max(self.solver.neighbourhood_deg / 2.0, away_theta.min())
        inside = np.where(near_theta[:, None] & near_r, self.likelihood, -1.0)  # eq. (8)
        j, i = np.unravel_index(inside.argmax(), inside.shape)
        return int(i), int(j)

    def iterate(self, p):
        draws = self.random.random((self.solver.max_edges, 3))
        for k, (u_r, u_theta, chi) in enumerate(draws):
            trial = list(self.lines)
            trial[k] = self.neighbour(self.lines[k], 2.0 * u_r - 1.0, 2.0 * u_theta - 1.0)
            cost = self.cost_of(trial)
            if chi < np.exp(min(-(cost - self.cost) / (5.0 / p**0.8), 700.0)):  # eq. (9)
                self.lines, self.cost = trial, cost

    def kept(self):
        lines, kept, passed = self.lines, list(range(len(self.lines))), False
        while not passed:
            passed = True
            for k in list(kept):
                if len(kept) == 3:
                    break
                now, then = self.iou([lines[i] for i in kept]), self.iou([lines[i] for i in kept if i != k])
                if now > 0.0 and abs((then - now) / now) < self.solver.edge_filter_epsilon:  # eq. (10)
                    kept.remove(k)
                    passed = False
        return kept


def parameters_for(heard, **solver):
    return heard.parameters.replaced({f'solver.{name}': value for name, value in solver.items()})


def evidence_of(mapper):
    return Evidence(tuple(mapper.soundings), mapper.beam_map, mapper.free_area)


@pytest.fixture(scope='module')
def window(heard):
    """The quadrilateral's evidence on a map of half a circle and coarse, uneven steps."""
    parameters = heard.parameters.replaced({
        'grid.angle_min_deg': -20.0, 'grid.angle_max_deg': 250.0, 'grid.angle_step_deg': 1.7,
        'grid.range_step_m': 0.011, 'grid.range_max_m': 1.8, 'solver.neighbourhood_m': 0.2})
    beam_map = BeamformingMap(parameters.grid)
    for sounding in heard.soundings:
        envelope = np.interp(beam_map.r_m, heard.beam_map.r_m, sounding.envelope).astype(np.float32)
        beam_map.add(sounding.x, sounding.y, envelope)
    return parameters, Evidence(tuple(heard.soundings), beam_map, heard.free_area)


def check_against_oracle(parameters, evidence, area_of, iterations):
    annealing = PaperSolver(parameters.replaced({'solver.iterations': iterations})).annealed(evidence)
    beam_map = evidence.beam_map
    oracle = Oracle(beam_map.normalised(), beam_map.r_m, np.rad2deg(beam_map.theta_rad), beam_map.full_circle,
                    evidence.free_area.shape, area_of, parameters)
    closed = 0
    for p in range(iterations + 1):
        if p:
            oracle.iterate(p)
        expected = np.array([(beam_map.r_m[i], beam_map.theta_rad[j]) for i, j in oracle.lines])
        np.testing.assert_array_equal(annealing.lines_at(p), expected, err_msg=f'iteration {p}')
        assert annealing.costs[p] == pytest.approx(oracle.cost, abs=1e-7)
        if p % 20 == 0:
            kept = oracle.kept()
            assert annealing.kept_at(p).tolist() == kept
            expected = oracle.polygon([oracle.lines[k] for k in kept])
            found = annealing.polygon_at(p)
            assert (shapely.Polygon(found).area if len(found) else 0.0) == pytest.approx(expected.area, rel=1e-9)
            closed += not expected.is_empty
    assert closed


@pytest.mark.parametrize('seed', [1, 2])
def test_every_decision_is_that_of_the_oracle(heard, seed):
    check_against_oracle(parameters_for(heard, seed=seed), evidence_of(heard), bounded_area, 300)


def test_every_decision_is_that_of_the_oracle_on_a_window_of_angles(window):
    check_against_oracle(*window, bounded_area, 100)


@pytest.mark.parametrize(('size_m', 'size_deg'), [(0.0, 0.0), (0.3, 360.0), (0.0123, 7.7)])
def test_every_decision_is_that_of_the_oracle_for_other_neighbourhoods(heard, size_m, size_deg):
    parameters = parameters_for(heard, neighbourhood_m=size_m, neighbourhood_deg=size_deg, max_edges=6)
    check_against_oracle(parameters, evidence_of(heard), bounded_area, 60)


@pytest.mark.parametrize('angles', [(0.0, 360.0), (-20.0, 250.0)])
@pytest.mark.parametrize(('size_m', 'size_deg'), [(0.0, 0.0), (0.1, 50.0), (0.31, 70.0), (2.0, 7.0)])
def test_every_decision_is_that_of_the_oracle_on_a_small_map(angles, size_m, size_deg):
    """Noise heard at a few places, on some hundred cells: quick without compilation, too."""
    parameters = Parameters().replaced({
        'grid.range_max_m': 0.9, 'grid.range_step_m': 0.03, 'grid.angle_step_deg': 15.0,
        'grid.angle_min_deg': angles[0], 'grid.angle_max_deg': angles[1], 'solver.neighbourhood_m': size_m,
        'solver.neighbourhood_deg': size_deg, 'solver.max_edges': 5, 'solver.iou_weight': 1.0})
    generator = np.random.default_rng(3)
    beam_map, free_area = BeamformingMap(parameters.grid), FreeArea()
    for x, y in generator.uniform(-0.2, 0.2, (5, 2)):
        beam_map.add(x, y, generator.uniform(0.0, 1.0, len(beam_map.r_m)).astype(np.float32))
        free_area.add(x, y, 0.3)
    check_against_oracle(parameters, Evidence((), beam_map, free_area), bounded_area, 60)


def test_the_trace_has_every_iteration(heard):
    annealing = PaperSolver(heard.parameters).annealed(evidence_of(heard))
    assert len(annealing.costs) == 301
    snapshot = Snapshot.of(evidence_of(heard))
    landscape = Landscape(snapshot.likelihood, snapshot.r_m, snapshot.theta_rad, snapshot.region.points,
                          snapshot.region.ends, snapshot.region.area, 3.0)
    for p in (0, 1, 100, 299, 300):
        lines = annealing.lines_at(p)
        cells = np.column_stack((np.rint(lines[:, 0] / 0.005), np.rint(np.rad2deg(lines[:, 1])))).astype(np.int64)
        assert annealing.costs[p] == cost_of(cells, landscape)
    assert annealing.costs[-1] < annealing.costs[0]


def test_a_solve_depends_on_the_evidence_when_it_began_and_on_the_seed_alone(heard):
    def solve(solver, soundings=heard.soundings):
        return solver.annealed(dataclasses.replace(evidence_of(heard), soundings=soundings)).costs

    solver = PaperSolver(heard.parameters)
    first = solve(solver)
    solve(solver, heard.soundings[:10])
    np.testing.assert_array_equal(solve(solver), first)
    assert not np.array_equal(solve(PaperSolver(parameters_for(heard, seed=2))), first)

    beam_map = BeamformingMap(heard.parameters.grid)
    beam_map.restore(heard.beam_map.state())
    loud = np.full(len(beam_map.r_m), 100.0, np.float32)
    changing = dataclasses.replace(evidence_of(heard), beam_map=beam_map)
    np.testing.assert_array_equal(solver.annealed(changing, lambda: beam_map.add(0.0, 0.0, loud)).costs, first)


def test_the_estimate_is_the_filtered_last_state(heard):
    annealing = PaperSolver(heard.parameters).annealed(evidence_of(heard))
    estimate = annealing.estimate()
    assert (estimate.status, estimate.method) == ('closed', 'paper')
    assert estimate.cost == annealing.costs[-1]
    np.testing.assert_array_equal(estimate.polygon.vertices, annealing.polygon_at())
    assert estimate.stamp_ns == max(sounding.stamp_ns for sounding in heard.soundings)
    likelihood = heard.beam_map.normalised()
    for edge in estimate.polygon.edges:
        row, column = round(np.rad2deg(edge.theta)), round(edge.r / 0.005)
        assert edge.likelihood == pytest.approx(likelihood[row, column])
        assert (edge.r_std, edge.theta_std) == (None, None)


def square_snapshot(lines_m=1.0):
    region = Region(shapely.box(-lines_m, -lines_m, lines_m, lines_m))
    return Snapshot(np.ones((4, 2), np.float32), np.array([0.0, 1.0]), np.zeros(4), True, region, np.zeros((9, 2)), 0,
                    np.ones(9, int))


CUT = (1.40, np.pi / 4)
"""Takes 0.02 % off a corner of the square of half side 1."""
SQUARE = [(1.0, 0.0), (1.0, np.pi / 2), (1.0, np.pi), (1.0, -np.pi / 2)]


@pytest.mark.parametrize(('lines', 'epsilon', 'kept'), [
    ([*SQUARE, CUT], 0.01, [0, 1, 2, 3]),
    ([CUT, *SQUARE], 0.01, [1, 2, 3, 4]),
    ([CUT, *SQUARE], 1e-6, [0, 1, 2, 3, 4]),
    ([*SQUARE, *SQUARE], 0.01, [4, 5, 6, 7]),
    ([(2.0, 0.3), *SQUARE, (3.0, 1.0)], 0.01, [1, 2, 3, 4]),
    ([(2.0, 0.3), *SQUARE], 0.0, [0, 1, 2, 3, 4]),
    (SQUARE[:3], 0.5, [0, 1, 2]),
    ([*SQUARE, *SQUARE], 10.0, [5, 6, 7]),
    ([SQUARE[0], SQUARE[0], SQUARE[1], SQUARE[2]], 0.01, [0, 1, 2, 3]),
])
def test_the_filter_drops_in_order_what_changes_the_overlap_little(lines, epsilon, kept):
    assert filtered(np.array(lines), square_snapshot(), epsilon).tolist() == kept


def test_without_a_free_area_nothing_is_filtered_and_no_polygon_is_claimed(heard):
    annealing = PaperSolver(heard.parameters).annealed(dataclasses.replace(evidence_of(heard), free_area=FreeArea()))
    assert len(annealing.kept_at()) == 10
    estimate = annealing.estimate()
    assert (estimate.status, estimate.polygon) == ('open', None)
    assert [caution.code for caution in estimate.cautions] == ['no_free_area']


def test_a_plate_of_a_thousandth_is_solved_alike(heard):
    """The same evidence with all lengths in millimetres called metres gives the same cells."""
    scale = 1e-3
    parameters = heard.parameters.replaced({
        'grid.range_max_m': 3.0 * scale, 'grid.range_step_m': 0.005 * scale, 'solver.neighbourhood_m': 0.054 * scale})
    beam_map, free_area = BeamformingMap(parameters.grid), FreeArea()
    for sounding in heard.soundings:
        beam_map.add(sounding.x * scale, sounding.y * scale, sounding.envelope)
        free_area.add(sounding.x * scale, sounding.y * scale, sounding.rho * scale)
    small = [dataclasses.replace(each, x=each.x * scale, y=each.y * scale) for each in heard.soundings]
    solutions = []
    for given, evidence in ((heard.parameters, evidence_of(heard)), (parameters, Evidence(small, beam_map, free_area))):
        solutions.append(PaperSolver(given).solve(evidence))
    np.testing.assert_allclose(solutions[1].polygon.vertices, scale * solutions[0].polygon.vertices, rtol=1e-6)
    assert solutions[1].cost == pytest.approx(solutions[0].cost, rel=1e-5)
