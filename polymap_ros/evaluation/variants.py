"""The kinds of random scenes that a method can be judged on, by name."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from polymap_ros.parameters import MediumParameters, SensorParameters
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.propagation import Propagation
from polymap_ros.simulation.random_scenes import Recipe, air_filled, lossy, mistaken, random_scene, storeyed
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import emitted


@dataclass(frozen=True)
class Variant:
    """How a random scene is made from its seed and number of edges, and within what a wall is right [m]."""

    text: str
    make: Callable[[int, int], Scene]
    tolerance_m: float = 0.003


def _shaped(recipe: Recipe) -> Callable[[int, int], Scene]:
    return lambda seed, edges: random_scene(seed, edges, recipe)


def _changed(**changes: Any) -> Callable[[int, int], Scene]:
    return lambda seed, edges: dataclasses.replace(random_scene(seed, edges), **changes)


def _faulty(**faults: Any) -> Callable[[int, int], Scene]:
    return lambda seed, edges: dataclasses.replace(random_scene(seed, edges), faults=Faults(**faults))


def _edged(**edges: Any) -> Callable[[int, int], Scene]:
    return lambda seed, count: dataclasses.replace(random_scene(seed, count), edges=Edges(**edges))


def _mistaken(**wrong: float) -> Callable[[int, int], Scene]:
    return lambda seed, edges: mistaken(random_scene(seed, edges), **wrong)


def _damped(reflection: float) -> Callable[[int, int], Scene]:
    def make(seed: int, edges: int) -> Scene:
        coefficients = np.ones(edges)
        coefficients[seed % edges] = reflection
        return dataclasses.replace(random_scene(seed, edges), reflection=coefficients)
    return make


def _travelling(**propagation: Any) -> Callable[[int, int], Scene]:
    return lambda seed, edges: dataclasses.replace(random_scene(seed, edges), propagation=Propagation(**propagation))


def _rolled(share: float) -> Callable[[int, int], Scene]:
    """A plate in which waves are fastest in a direction that is drawn."""
    def make(seed: int, edges: int) -> Scene:
        along = float(np.random.default_rng([seed, edges, 10]).uniform(0.0, 180.0))
        return _travelling(anisotropy=share, anisotropy_deg=along)(seed, edges)
    return make


def _curved(radius_m: float) -> Callable[[int, int], Scene]:
    """A plate of which one edge bulges, outwards or inwards."""
    def make(seed: int, edges: int) -> Scene:
        inwards = np.random.default_rng([seed, edges, 11]).random() < 0.5
        return _edged(curvature_1_m=(-1.0 if inwards else 1.0) / radius_m, curved_edge=seed % edges)(seed, edges)
    return make


def _off_centre(seed: int, edges: int) -> float:
    """A transducer's frequency over the pulse's, -8 to +8 % off, by the seed and the number of edges."""
    return float(np.random.default_rng([seed, edges, 8]).uniform(0.92, 1.08))


def mild(scene: Scene) -> Scene:
    """The scene with everything that a real plate and a real device do, none of it strong."""
    faults = dataclasses.replace(scene.faults, transducer_q=3.0, directivity=0.3, noise_colour=0.9,
                                 transducer_centre=_off_centre(scene.seed, len(scene.vertices)))
    return dataclasses.replace(
        scene, faults=faults, edges=Edges(kind='free', poisson=0.30), propagation=Propagation(attenuation_np_m=0.35),
        gain_range_db=12.0, order=8, reflection=np.full(len(scene.vertices), 0.9))


def _resonant(quality: float, times: int = 1, **edges: Any) -> Callable[[int, int], Scene]:
    """A transducer whose centre is off."""
    def make(seed: int, count: int) -> Scene:
        faults = Faults(transducer_q=quality, transducer_centre=_off_centre(seed, count), transducer_times=times)
        return dataclasses.replace(random_scene(seed, count), faults=faults, edges=Edges(**edges))
    return make


def _filed(make: Callable[[int, int], Scene]) -> Callable[[int, int], Scene]:
    """The same where the pulse that comes out of the transducer is given as a file."""
    def make_filed(seed: int, count: int) -> Scene:
        scene = make(seed, count)
        return dataclasses.replace(scene, faults=Faults(), recorded_pulse=emitted(scene).samples(scene.period_s))
    return make_filed


_ALUMINIUM = MediumParameters()
_STEEL = MediumParameters(longitudinal_speed_m_s=5960.0, shear_speed_m_s=3235.0)


def _material(true: MediumParameters, told: MediumParameters) -> Callable[[int, int], Scene]:
    return lambda seed, edges: dataclasses.replace(random_scene(seed, edges), medium=true, told_medium=told)


def _apart(seed: int, edges: int) -> Scene:
    return dataclasses.replace(random_scene(seed, edges), sensor=SensorParameters(baseline_x_m=0.05))


VARIANTS = {
    'plate': Variant('metal plates, 60 pings', random_scene),
    'pings_20': Variant('20 pings', _shaped(Recipe(pings=20))),
    'pings_40': Variant('40 pings', _shaped(Recipe(pings=40))),
    'lossy': Variant('reflection coefficients of 0.5 to 1 and random sign per edge',
                     lambda seed, edges: lossy(random_scene(seed, edges))),
    'gain': Variant('gain of the echoes varying by 6 dB from ping to ping', _changed(gain_range_db=6.0)),
    'position_noise': Variant('position noise of 5 mm', _changed(position_noise_m=0.005)),
    'air': Variant('rooms of 4 to 8 m, air, 20 kHz burst',
                   lambda seed, edges: air_filled(random_scene(seed, edges)), tolerance_m=0.01),
    'air_chirp': Variant('rooms of 4 to 8 m, air, chirp of 10 to 30 kHz',
                         lambda seed, edges: air_filled(random_scene(seed, edges), 'chirp'), tolerance_m=0.01),
    'room': Variant('the same, burst, with floor and ceiling; all reflect 0.7 to 0.9',
                    lambda seed, edges: storeyed(air_filled(random_scene(seed, edges))), tolerance_m=0.01),
    'right_angled': Variant('right-angled shapes', _shaped(Recipe('right_angled'))),
    'regular': Variant('regular polygons', _shaped(Recipe('regular'))),
    'needle': Variant('needle-thin triangles (3 edges only)', _shaped(Recipe('needle'))),
    'unequal': Variant('very unequal edges (4 edges or more)', _shaped(Recipe('unequal'))),
    'missing_first': Variant('20 % of the pings without their nearest echo', _faulty(missing_first=0.2)),
    'false_first': Variant('20 % of the pings with a false echo at a shorter range', _faulty(false_first=0.2)),
    'clutter': Variant('direct wave up to 0.15 m and an echo at 0.4 m in every ping, 20 dB over the echoes',
                       _faulty(direct_wave=10.0, clutter=10.0)),
    's0_-20db': Variant('S0 20 dB below A0', _faulty(second_mode=0.1)),
    's0_-10db': Variant('S0 10 dB below A0', _faulty(second_mode=10.0**-0.5)),
    's0_0db': Variant('S0 as strong as A0', _faulty(second_mode=1.0)),
    'apart': Variant('emitter and receiver 5 cm apart, given', _apart),
    'thinner': Variant('thickness taken 20 % too small', _mistaken(thickness_m=0.8 * _ALUMINIUM.thickness_m)),
    'thicker': Variant('thickness taken 20 % too large', _mistaken(thickness_m=1.2 * _ALUMINIUM.thickness_m)),
    'steel_as_aluminium': Variant('steel taken for aluminium', _material(_STEEL, _ALUMINIUM)),
    'aluminium_as_steel': Variant('aluminium taken for steel', _material(_ALUMINIUM, _STEEL)),
    'free_edge': Variant("a plate's free edges (Kirchhoff), Poisson's ratio of 0.30 not told",
                         _edged(kind='free', poisson=0.30)),
    'q_3': Variant('a transducer of Q 3, -8 to +8 % off, not told', _resonant(3.0)),
    'q_5': Variant('the same, Q 5', _resonant(5.0)),
    'q_10': Variant('the same, Q 10', _resonant(10.0)),
    'q_5_twice': Variant('the same, Q 5 as emitter and as receiver', _resonant(5.0, 2)),
    'q_5_free_edge': Variant('the same, Q 5, and free edges', _resonant(5.0, kind='free', poisson=0.30)),
    'q_5_file': Variant('Q 5, the true pulse given as a file', _filed(_resonant(5.0))),
    'q_10_file': Variant('Q 10, the same', _filed(_resonant(10.0))),
    'q_5_twice_file': Variant('Q 5 as emitter and as receiver, the same', _filed(_resonant(5.0, 2))),
    'q_5_free_edge_file': Variant('Q 5 and free edges, the same', _filed(_resonant(5.0, kind='free', poisson=0.30))),
    'phase_45': Variant('every reflection delays the phase by 45 degrees', _edged(delay_deg=45.0)),
    'phase_90': Variant('the same, 90 degrees', _edged(delay_deg=90.0)),
    'phase_180': Variant('the same, 180 degrees', _edged(delay_deg=180.0)),
    'phase_by_wall': Variant('each wall by its own, within 45 degrees', _edged(spread_deg=45.0)),
    'delay': Variant('every reflection delays the wave by a quarter of a cycle, whatever its frequency',
                     _edged(delay_s=2.5e-6)),
    'attenuated': Variant('a metre of the way takes 0.35 Np, in proportion to frequency',
                          _travelling(attenuation_np_m=0.35)),
    'directed': Variant('the device hears and speaks by 1 + 0.3 cos(phi)', _faulty(directivity=0.3)),
    'coloured': Variant('noise of which a sample passes 0.9 on to the next', _faulty(noise_colour=0.9)),
    'mild': Variant('free edges, Q 3, attenuation, directivity, coloured noise, gain of +-6 dB, order 8 at 0.9',
                    lambda seed, edges: mild(random_scene(seed, edges))),
    'speed_drift_0.5': Variant('waves that get faster by 0.5 % while the robot drives', _travelling(speed_drift=0.005)),
    'speed_drift_1': Variant('the same, by 1 %', _travelling(speed_drift=0.01)),
    'anisotropy_1': Variant('a rolled plate, k (1 - 0.01 cos 2 phi)', _rolled(0.01)),
    'anisotropy_2': Variant('the same, 0.02', _rolled(0.02)),
    'edge_fading': Variant('echoes that fade over a Fresnel zone at the ends of walls, and corners that diffract',
                           _changed(edge_fading='fresnel')),
    'order_4': Variant('echoes up to order 4 only, without loss', _changed(order=4)),
    'order_8': Variant('echoes up to order 8, reflection coefficients of 0.8 to 0.95',
                       lambda seed, edges: dataclasses.replace(lossy(random_scene(seed, edges), 0.8, 0.95), order=8)),
    'damped_0.3': Variant('one edge reflects 0.3, the others all', _damped(0.3)),
    'damped_0.2': Variant('one edge reflects 0.2, the others all', _damped(0.2)),
    'curved_100': Variant('one edge is curved by a radius of 100 m, outwards or inwards', _curved(100.0)),
    'curved_20': Variant('the same, 20 m', _curved(20.0)),
    'rounded': Variant('corners rounded by 20 mm', _edged(corner_radius_m=0.02)),
    'line': Variant("a line of 90 kHz as strong as the echoes", _faulty(lines=1)),
    'line_+4db': Variant('the same, 4 dB stronger', _faulty(lines=1, line_db=4.0)),
    'line_+10db': Variant('the same, 10 dB stronger', _faulty(lines=1, line_db=10.0)),
    'lines': Variant('three lines of 70, 91 and 118 kHz, each as strong as the echoes', _faulty(lines=3, line_hz=70e3)),
    'impulses': Variant('impulses on 2 % of the samples, 30 deviations of the noise strong', _faulty(impulses=0.02)),
    'impulses_rung': Variant("the same, on 0.5 %, as long as a receiver's filter makes them",
                             _faulty(impulses=0.005, impulse_width=0.7)),
    'yaw_drift': Variant('heading that drifts by 2 degrees per metre', _faulty(yaw_drift_deg_m=2.0)),
    'odometry_scale': Variant('odometry that reports 2 % too much', _faulty(odometry_scale=1.02)),
}
