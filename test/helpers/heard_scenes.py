"""Scenes that a mapper, or a likelihood, has heard."""

import dataclasses

import numpy as np

from polymap_ros.acoustics.ping import Ping
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.listening import Listener
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import noise_free, simulate
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.solver import EvidenceSolver

TRIANGLE = np.array([(0.0, 0.0), (1.2, 0.0), (0.4, 0.9)])
PENTAGON = np.array([(0.0, 0.0), (1.0, 0.0), (1.3, 0.7), (0.6, 1.2), (-0.2, 0.6)])


def feed(mapper, scene, samples):
    """Give a mapper all poses and pings of a scene."""
    for stamp_ns, pose, row in zip(scene.stamps_ns.tolist(), scene.reported_poses().tolist(), samples, strict=True):
        mapper.add_pose(stamp_ns, Pose(*pose))
        mapper.add_ping(Ping(stamp_ns, row, scene.period_s, scene.t0_s))


@dataclasses.dataclass(frozen=True)
class Heard:
    """What the pings of a scene sound like: samples with noise of `sigma`, and as the likelihoods read them.

    The walls, `lines` (n, 2) with their `reflection`, are sorted by theta.
    """

    scene: Scene
    lines: np.ndarray
    reflection: np.ndarray
    samples: np.ndarray
    sigma: float
    data: EchoData


def hear(vertices, positions, snr_db=0.0, clean=False, **rest):
    """Simulate pings at positions; all have noise of the same `sigma`, or none, and `sigma` is the unit either way."""
    scene = Scene('room', vertices, np.column_stack((positions, np.zeros(len(positions)))), **rest)
    echoes = noise_free(scene)
    sigma = float(np.sqrt(np.mean(echoes**2) * 10.0 ** (-snr_db / 10.0)))
    samples = echoes if clean else echoes + sigma * scene.noise()
    parameters = scene.parameters(Parameters())
    listener = Listener(parameters, BeamformingMap(parameters.grid).r_m)
    soundings = []
    for (x, y), ping in zip(positions, samples, strict=True):
        heard = listener.hear(Ping(0, ping, scene.period_s, scene.t0_s))
        noise = sigma / np.linalg.norm(ping)
        soundings.append(Sounding(0, x, y, heard.echo, heard.envelope, heard.rho, noise, heard_m=heard.heard_m))
    sensor = scene.sensor
    data = EchoData.of(soundings, listener.shape, 0.5, parameters.echo.blanking_m,
                       (sensor.baseline_x_m, sensor.baseline_y_m, sensor.baseline_z_m))
    lines = polygon_lines(scene.vertices)
    order = np.argsort(lines[:, 1])
    return Heard(scene, lines[order], scene.reflection[order], samples, sigma, data)


def some(data, pings):
    """The data of some pings only."""
    arrays = {each.name: getattr(data, each.name) for each in dataclasses.fields(data)}
    return dataclasses.replace(data, **{name: array[pings] for name, array in arrays.items()
                                        if isinstance(array, np.ndarray)})


def listen(scene, samples=None, count=None, changes=None):
    """A mapper that has heard a scene, or the first pings of it."""
    mapper = PolygonMapper(scene.parameters(Parameters()).replaced(changes or {}))
    samples = simulate(scene).astype(np.float32) if samples is None else samples
    feed(mapper, dataclasses.replace(scene, poses=scene.poses[:count]), samples[:count])
    return mapper


def solved(scene, **changes):
    """The evidence solver, with changed parameters, of a mapper that has heard a scene; the mapper; and the answer."""
    mapper = filled_mapper(scene, Parameters())
    solver = EvidenceSolver(mapper.parameters.replaced(changes))
    return solver, mapper, solver.solve(mapper.evidence)
