"""The kinds of random scenes that a method can be judged on, by name."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

from polymap_ros.simulation.random_scenes import Recipe, air_filled, lossy, random_scene
from polymap_ros.simulation.scenes import Scene


@dataclass(frozen=True)
class Variant:
    """How a random scene is made from its seed and number of edges, and within what a wall is right [m]."""

    text: str
    make: Callable[[int, int], Scene]
    tolerance_m: float = 0.003


def _shaped(recipe: Recipe) -> Callable[[int, int], Scene]:
    return lambda seed, edges: random_scene(seed, edges, recipe)


def _changed(**changes: float) -> Callable[[int, int], Scene]:
    return lambda seed, edges: dataclasses.replace(random_scene(seed, edges), **changes)  # type: ignore[arg-type]


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
    'right_angled': Variant('right-angled shapes', _shaped(Recipe('right_angled'))),
    'regular': Variant('regular polygons', _shaped(Recipe('regular'))),
    'needle': Variant('needle-thin triangles (3 edges only)', _shaped(Recipe('needle'))),
    'unequal': Variant('very unequal edges (4 edges or more)', _shaped(Recipe('unequal'))),
}
