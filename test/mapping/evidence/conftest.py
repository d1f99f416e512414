"""Shared parts of the evidence tests: rooms, and what a sensor in them hears, in units of a noise that is known."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.mapping.beamforming import BeamformingMap
from polymap_ros.mapping.evidence.data import EchoData
from polymap_ros.mapping.lines import polygon_lines
from polymap_ros.mapping.listening import Listener
from polymap_ros.mapping.sounding import Sounding
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import noise_free

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
    data = EchoData.of(soundings, listener.shape, 0.5, parameters.echo.blanking_m)
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


@pytest.fixture(scope='session')
def hear():
    return _hear


@pytest.fixture(scope='session')
def inside():
    return _inside


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
