"""Shared parts of the evidence tests: rooms, and what a sensor in them hears, in units of a noise that is known."""

import dataclasses
import itertools

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.mapping.beamforming import BeamformingMap
from polymap_ros.mapping.evidence.data import EchoData
from polymap_ros.mapping.lines import half_plane_polygon, polygon_lines
from polymap_ros.mapping.listening import Listener
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.sounding import Sounding
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import noise_free, simulate

TRIANGLE = np.array([(0.0, 0.0), (1.2, 0.0), (0.4, 0.9)])
PENTAGON = np.array([(0.0, 0.0), (1.0, 0.0), (1.3, 0.7), (0.6, 1.2), (-0.2, 0.6)])


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


def _hear(vertices, positions, snr_db=0.0, clean=False, **rest):
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
        soundings.append(Sounding(0, x, y, heard.echo, heard.envelope, heard.rho, noise))
    sensor = scene.sensor
    data = EchoData.of(soundings, listener.shape, 0.5, parameters.echo.blanking_m,
                       (sensor.baseline_x_m, sensor.baseline_y_m, sensor.baseline_z_m))
    lines = polygon_lines(scene.vertices)
    order = np.argsort(lines[:, 1])
    return Heard(scene, lines[order], scene.reflection[order], samples, sigma, data)


def _inside(vertices, count, seed=0, clearance=0.06):
    """Points inside a convex polygon, at least so far from its walls."""
    generator = np.random.default_rng(seed)
    lines = polygon_lines(vertices)
    normals = np.array((np.cos(lines[:, 1]), np.sin(lines[:, 1])))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    points = generator.uniform(low, high, size=(100 * count, 2))
    return points[np.all(points @ normals < lines[:, 0] - clearance, axis=1)][:count]


@dataclasses.dataclass(frozen=True)
class Path:
    """One sequence of walls, for many pings: half the length [m] and what the walls' ends leave, both (N,)."""

    walls: tuple[int, ...]
    half: np.ndarray
    weight: np.ndarray


def _unfold(lines, emitters, order, soft, receivers=None, height=0.0):
    """All sequences of walls that some ping hears, each unfolded in the complex plane; ends are hard where soft is 0.

    Inside its end by s, a hit counts 1/2 + (3 x - x^3) / 4 with x = s / soft within -1 ... 1; a path, its least hit.
    The receiver is that much higher than the emitter; walls are upright.
    """
    vertices, which = half_plane_polygon(lines)
    corners = {int(wall): vertices[i] @ (1, 1j) for i, wall in enumerate(which)}
    along = {int(wall): vertices[(i + 1) % len(which)] @ (1, 1j) - corners[int(wall)] for i, wall in enumerate(which)}
    source = np.asarray(emitters) @ (1, 1j)
    target = source if receivers is None else np.asarray(receivers) @ (1, 1j)
    paths = []
    for count in range(1, order + 1):
        for walls in itertools.product(corners, repeat=count):
            if any(a == b for a, b in itertools.pairwise(walls)):
                continue
            images = [source]
            for wall in walls:
                images.append(corners[wall] + along[wall] * np.conj((images[-1] - corners[wall]) / along[wall]))
            here, inside = target, np.full(len(source), np.inf)
            for wall, image in zip(walls[::-1], images[:0:-1], strict=True):
                p, q = ((place - corners[wall]) / along[wall] for place in (here, image))
                crosses = (q.imag < 0.0) & (q.imag < p.imag)
                share = p.real + (q - p).real * p.imag / np.where(crosses, p.imag - q.imag, np.nan)
                here = corners[wall] + share * along[wall]
                inside = np.minimum(inside, abs(along[wall]) * np.minimum(share, 1.0 - share))
            inside = np.nan_to_num(inside, nan=-np.inf)
            x = np.clip(inside / soft, -1.0, 1.0) if soft else np.sign(inside)
            weight = 0.5 + (3.0 * x - x**3) / 4.0
            if np.any(weight > 0.0):
                paths.append(Path(walls, np.hypot(abs(images[-1] - target), height) / 2.0, weight))
    return paths


def _away_from_ends(lines, positions, order, soft):
    """Which pings hear no path near the end of a wall."""
    weights = np.array([path.weight for path in _unfold(lines, positions, order, soft)])
    return np.all((weights == 0.0) | (weights == 1.0), axis=0)


def _some(data, pings):
    """The data of some pings only."""
    arrays = {each.name: getattr(data, each.name) for each in dataclasses.fields(data)}
    return dataclasses.replace(data, **{name: array[pings] for name, array in arrays.items()
                                        if isinstance(array, np.ndarray)})


@pytest.fixture(scope='session')
def hear():
    return _hear


@pytest.fixture(scope='session')
def inside():
    return _inside


@pytest.fixture(scope='session')
def unfold():
    return _unfold


@pytest.fixture(scope='session')
def away_from_ends():
    return _away_from_ends


@pytest.fixture(scope='session')
def some():
    return _some


@pytest.fixture(scope='session')
def triangle():
    return TRIANGLE


@pytest.fixture(scope='session')
def pentagon():
    return PENTAGON


@pytest.fixture(scope='session')
def in_pentagon():
    """Forty noisy pings about the pentagon at 0 dB, order 5."""
    return _hear(PENTAGON, _inside(PENTAGON, 40), seed=3)


@pytest.fixture(scope='module')
def listen(feed):
    """A mapper that has heard a scene, or the first pings of it."""

    def mapper_of(scene, samples=None, count=None, changes=None):
        mapper = PolygonMapper(scene.parameters(Parameters()).replaced(changes or {}))
        samples = simulate(scene).astype(np.float32) if samples is None else samples
        part = dataclasses.replace(scene, poses=scene.poses[:count])
        feed(mapper, part, samples[:count])
        return mapper

    return mapper_of


@pytest.fixture(scope='module')
def hexagon(listen):
    """A scene of six edges, its samples, its first answer (by sixty pings) and the mapper's state before that."""
    scene = random_scene(107, 6)
    samples = simulate(scene).astype(np.float32)
    mapper = listen(scene, samples)
    state = mapper.state()
    return scene, samples, mapper.solve(), state
