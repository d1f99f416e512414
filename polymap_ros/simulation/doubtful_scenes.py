"""Scenes in which a convex polygon is not the answer, or not all of it: what must never be answered silently wrong."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.parameters import MediumParameters
from polymap_ros.simulation.clearance import half_planes
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.inside import Partition
from polymap_ros.simulation.random_scenes import air_filled, mistaken, random_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.shaped_scenes import clean_echoes, l_shape, t_shape
from polymap_ros.simulation.trajectories import legs_inside
from polymap_ros.simulation.waveforms import noise_free

_PINGS, _STEP_M, _CLEARANCE_M = 60, 0.14, 0.06
_SEAM = 0.5
_STREAM = 6


@dataclass(frozen=True, eq=False)
class Doubtful:
    """What is heard, and what the mapper believes.

    Parameters
    ----------
    scene : Scene
        Path, noise and what the mapper is told; its polygon is the truth.
    clean : ndarray, shape (T, n_samples)
        What is heard, without noise.
    """

    scene: Scene
    clean: NDArray[np.float64]


@dataclass(frozen=True)
class DoubtfulKind:
    """How a scene is made from its seed and number of edges, and whether an answer without a warning is a fault."""

    text: str
    make: Callable[[int, int], Doubtful]
    must_be_flagged: bool = True


def _generator(scene: Scene) -> np.random.Generator:
    return np.random.default_rng([scene.seed, len(scene.vertices), _STREAM])


def _as_it_is(scene: Scene) -> Doubtful:
    return Doubtful(scene, noise_free(scene))


def _along_a_line(width: float) -> Callable[[int, int], Doubtful]:
    """A path along one line, winding by this share of its length from side to side."""
    def make(seed: int, edges: int) -> Doubtful:
        scene = random_scene(seed, edges)
        normals, offsets = half_planes(scene.vertices)
        places = _generator(scene).uniform(scene.vertices.min(axis=0), scene.vertices.max(axis=0), size=(4000, 2))
        places = places[(places @ normals.T <= offsets - _CLEARANCE_M - 0.04).all(axis=1)][:40]
        apart = np.linalg.norm(places[:, None] - places[None], axis=2)
        start, end = places[list(np.unravel_index(apart.argmax(), apart.shape))]
        share = np.linspace(0.0, 1.0, _PINGS)
        along = end - start
        aside = 0.5 * width * np.sin(3.0 * np.pi * share)[:, None] * np.array((-along[1], along[0]))
        positions = start + share[:, None] * along + aside
        headings = np.full(_PINGS, np.arctan2(along[1], along[0]))
        return _as_it_is(dataclasses.replace(scene, poses=np.column_stack((positions, headings))))
    return make


def _unheard(seed: int, edges: int) -> Doubtful:
    """One edge reflects nothing."""
    scene = random_scene(seed, edges)
    reflection = np.ones(edges)
    reflection[_generator(scene).integers(edges)] = 0.0
    return _as_it_is(dataclasses.replace(scene, reflection=reflection))


def _not_convex(outline: Callable[[np.random.Generator], NDArray[np.float64]]) -> Callable[[int, int], Doubtful]:
    def make(seed: int, edges: int) -> Doubtful:
        generator = np.random.default_rng([seed, edges, _STREAM])
        corners, turn = outline(generator), generator.uniform(0.0, 2.0 * np.pi)
        c, s = np.cos(turn), np.sin(turn)
        corners = (corners - corners.mean(axis=0)) @ np.array([[c, s], [-s, c]])
        poses = legs_inside(corners, _PINGS, _STEP_M, _CLEARANCE_M, generator)
        scene = Scene(name='', vertices=corners, poses=poses, seed=seed)
        return Doubtful(scene, clean_echoes(scene))
    return make


def _seam(share: float) -> Callable[[int, int], Doubtful]:
    """A line inside, over this share of a chord of the room, that reflects half the amplitude."""
    def make(seed: int, edges: int) -> Doubtful:
        scene = random_scene(seed, edges)
        generator = _generator(scene)
        normals, offsets = half_planes(scene.vertices)
        middle = generator.dirichlet(np.full(edges, 5.0)) @ scene.vertices
        angle = generator.uniform(0.0, np.pi)
        along = np.array((np.cos(angle), np.sin(angle)))
        with np.errstate(divide='ignore'):
            reach = (offsets - normals @ middle) / (normals @ along)
        low, high = reach[reach < 0.0].max(), reach[reach > 0.0].min()
        low, high = 0.5 * (low + high) + 0.5 * share * np.array((-1.0, 1.0)) * (high - low)
        seam = Partition(middle + low * along, middle + high * along, _SEAM)
        return _as_it_is(dataclasses.replace(scene, inner_walls=(seam,)))
    return make


def _second_mode(amplitude: float) -> Callable[[int, int], Doubtful]:
    """The same room heard by S0, too."""
    def make(seed: int, edges: int) -> Doubtful:
        return _as_it_is(dataclasses.replace(random_scene(seed, edges), faults=Faults(second_mode=amplitude)))
    return make


def _mistaken(**wrong: float) -> Callable[[int, int], Doubtful]:
    """The mapper is told another medium."""
    def make(seed: int, edges: int) -> Doubtful:
        return _as_it_is(mistaken(random_scene(seed, edges), **wrong))
    return make


def _mistaken_air(seed: int, edges: int) -> Doubtful:
    scene = air_filled(random_scene(seed, edges))
    return _as_it_is(mistaken(scene, speed_m_s=1.2 * scene.medium.speed_m_s))


_PLATE = MediumParameters()

ORDINARY = 'ordinary'
"""The kind that is to be flagged as rarely as can be."""

KINDS = {
    'straight': DoubtfulKind('straight path', _along_a_line(0.0)),
    'nearly_straight': DoubtfulKind('path 1.5 % as wide as long', _along_a_line(0.015)),
    'bent': DoubtfulKind('path 5 % as wide as long', _along_a_line(0.05), must_be_flagged=False),
    'unheard': DoubtfulKind('one wall reflects nothing', _unheard),
    'l_shape': DoubtfulKind('L-shaped outline', _not_convex(l_shape), must_be_flagged=False),
    't_shape': DoubtfulKind('T-shaped outline', _not_convex(t_shape), must_be_flagged=False),
    'seam': DoubtfulKind('seam across the room that reflects half the amplitude', _seam(1.0), must_be_flagged=False),
    'stiffener': DoubtfulKind('line inside, half as long, that reflects half the amplitude', _seam(0.5),
                              must_be_flagged=False),
    'mode_0db': DoubtfulKind('S0 as strong as A0', _second_mode(1.0)),
    'mode_-10db': DoubtfulKind('S0 10 dB below A0', _second_mode(10.0**-0.5)),
    'wrong_speeds': DoubtfulKind('both speeds of the plate taken 20 % too low', _mistaken(
        longitudinal_speed_m_s=0.8 * _PLATE.longitudinal_speed_m_s, shear_speed_m_s=0.8 * _PLATE.shear_speed_m_s)),
    'wrong_thickness': DoubtfulKind('thickness taken 20 % too small', _mistaken(thickness_m=0.8 * _PLATE.thickness_m)),
    'wrong_air': DoubtfulKind('rooms of air, speed taken 20 % too high', _mistaken_air),
    ORDINARY: DoubtfulKind('ordinary', lambda seed, edges: _as_it_is(random_scene(seed, edges)), must_be_flagged=False),
}
