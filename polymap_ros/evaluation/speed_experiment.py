"""What an equation and a solve cost, beside something that everybody knows."""

import dataclasses
from itertools import cycle

import numpy as np
import shapely
from numpy.typing import NDArray

from polymap_ros.acoustics.matched_filter import MatchedFilter
from polymap_ros.acoustics.medium import Medium, make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import Pulse, make_pulse
from polymap_ros.evaluation.paired import Paired, paired
from polymap_ros.evaluation.round_trip import RoundTrip
from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.geometry.pose import Pose
from polymap_ros.map_parameters import GridParameters
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.maps.thinning import KEPT_PINGS
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.paper.annealing import Landscape, cost_of
from polymap_ros.solvers.paper.solver import PaperSolver

N_SAMPLES, PERIOD_S = 8192, 1e-6
GRID = GridParameters(range_max_m=2.995, range_step_m=0.005)
"""600 ranges x 360 angles."""

PING_HZ, PING_PERIOD_S = 2.0, 0.05
"""Pings of the drive that is solved, and the period that a warm solve is compared with."""

LEAST_S = 0.02
SOME_STATES = 60


def matched_filter_cost(parameters: Parameters, repetitions: int) -> Paired:
    """Eq. (3), complex and envelope, of one ping."""
    medium, pulse = make_medium(parameters.medium), make_pulse(parameters.pulse)
    ranges_m = BeamformingMap(GRID).r_m
    samples = RoundTrip(1.0 / 30.0, N_SAMPLES).samples()[0]
    matched, doubles = MatchedFilter(medium, pulse, ranges_m, N_SAMPLES, PERIOD_S), samples.astype(float)

    def operation() -> NDArray[np.float32]:
        return np.abs(matched(samples))

    def reference() -> NDArray[np.float64]:
        return np.fft.irfft(np.fft.rfft(doubles, 2 * N_SAMPLES))

    result = paired(
        (f'eq. (3), complex and envelope, {N_SAMPLES} samples, 600 ranges, dispersive', operation),
        (f"numpy's rfft + irfft of the ping zero-padded to {2 * N_SAMPLES}", reference), repetitions, '<= 1.5', LEAST_S)
    exact = exact_eq_3(doubles, medium, pulse, ranges_m)
    error = np.abs(matched(samples) - exact).max() / np.abs(exact).max()
    return dataclasses.replace(result, note=f'error {error:.1g} of the peak')


def exact_eq_3(
    samples: NDArray[np.float64], medium: Medium, pulse: Pulse, ranges_m: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Eq. (3) by summing up all frequencies for every range: nothing cut off, interpolated or rounded."""
    size = 4 * len(samples)
    omega = 2.0 * np.pi * np.fft.rfftfreq(size, PERIOD_S)[1:]
    step = float(omega[1] - omega[0]) / np.pi
    echo = pulse.spectrum(omega) * medium.excitability(omega)
    norms = np.linalg.norm(samples) * np.sqrt(PERIOD_S) * np.sqrt(np.sum(np.abs(echo) ** 2) * step)
    product = np.fft.rfft(samples, size)[1:] * PERIOD_S * np.conj(echo) * step / norms
    wavenumbers = medium.wavenumber(omega)
    values: NDArray[np.complex128] = np.array([np.sum(product * np.exp(2j * wavenumbers * r)) for r in ranges_m])
    return values


def beamforming_cost(repetitions: int) -> Paired:
    """Eq. (4) of one ping."""
    beam_map = BeamformingMap(GRID)
    n_theta, n_r = len(beam_map.theta_rad), len(beam_map.r_m)
    random = np.random.default_rng(1)
    envelope = random.random(n_r).astype(np.float32)
    total, addend = random.random((2, n_theta, n_r)).astype(np.float32)
    return paired((f'eq. (4), {n_r} x {n_theta} cells, float32', lambda: beam_map.add(0.31, -0.17, envelope)),
                  ('adding an array of that size in place', lambda: np.add(total, addend, out=total)), repetitions,
                  '<= 2', LEAST_S)


def overlap_cost(mapper: PolygonMapper, repetitions: int) -> Paired:
    """Eq. (5) of the states of an annealing in which the lines bound an area."""
    parameters = mapper.parameters.replaced({'solver.method': 'paper'})
    annealing = PaperSolver(parameters).annealed(mapper.evidence)
    snapshot = annealing.snapshot
    landscape = Landscape(
        snapshot.likelihood, snapshot.r_m, snapshot.theta_rad, snapshot.region.points, snapshot.region.ends,
        snapshot.region.area, parameters.solver.iou_weight)
    axes = (snapshot.r_m, snapshot.theta_rad)
    cells: list[NDArray[np.intp]] = []
    polygons: list[shapely.Polygon] = []
    for iteration in range(parameters.solver.iterations):
        lines = annealing.lines_at(iteration)
        corners = half_plane_polygon(lines)[0]
        if len(corners) and len(cells) < SOME_STATES:
            cells.append(np.column_stack([np.searchsorted(axis, lines[:, k]) for k, axis in enumerate(axes)]))
            polygons.append(shapely.Polygon(corners))
    free = mapper.free_area.shape
    states, shapes = cycle(cells), cycle(polygons)
    return paired(
        (f'eq. (5), K = {parameters.solver.max_edges}', lambda: cost_of(next(states), landscape)),
        ('shapely.intersection(M, A_T).area', lambda: shapely.intersection(next(shapes), free).area), repetitions,
        '<= 0.25', LEAST_S)


def solve_costs(drive: 'Drive', repetitions: int) -> list[Paired]:
    """A solve from scratch, and one from the last answer and a ping more, once as many as may be are kept."""
    parameters = drive.mapper.parameters
    method = parameters.solver.method

    def cold() -> None:
        drive.mapper.configure(parameters)
        drive.mapper.solve()

    def warm() -> None:
        drive.go(1)
        drive.mapper.solve()

    period = 'a ping period at 20 Hz', PING_PERIOD_S
    from_scratch = paired((f'{method} solve from scratch', cold), period, max(1, repetitions // 4), '')
    drive.go(2 * KEPT_PINGS)
    warm()
    return [from_scratch, paired((f'{method} solve, warm, of {KEPT_PINGS} pings, and the ping before it', warm), period,
                                 repetitions, '<= 0.5')]


class Drive:
    """Round and round in a plate, ping by ping."""

    def __init__(self, parameters: Parameters, n_samples: int = 4096, ping_hz: float = PING_HZ) -> None:
        self.trip = RoundTrip(ping_hz, n_samples)
        self.mapper = PolygonMapper(parameters)
        self._samples, self._count = self.trip.samples(), 0

    def go(self, pings: int) -> None:
        """Drive on for so many pings."""
        first = self._count
        times_s = (first + np.arange(pings)) / self.trip.ping_hz
        for k, pose in enumerate(self.trip.poses(times_s).tolist(), first):
            stamp_ns = round(k / self.trip.ping_hz * 1e9)
            self.mapper.add_pose(stamp_ns, Pose(*pose))
            self.mapper.add_ping(Ping(stamp_ns, self._samples[k % len(self._samples)], PERIOD_S))
        self._count += pings
