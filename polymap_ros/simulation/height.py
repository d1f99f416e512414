"""A room's floor and ceiling in a scene; none by default."""

from dataclasses import dataclass

import numpy as np

from polymap_ros.geometry.storey import Storey
from polymap_ros.specification import Group, parameter


@dataclass(frozen=True)
class Height(Group):
    """How far floor and ceiling are from the emitter, and what they reflect."""

    PREFIX = 'height.'
    floor_m: float = parameter(0.0, 'of the emitter above the floor; 0: there is none', unit='m', minimum=0.0,
                               maximum=1000.0)
    ceiling_m: float = parameter(0.0, 'of the ceiling above the emitter; 0: there is none', unit='m', minimum=0.0,
                                 maximum=1000.0)
    floor_reflection: float = parameter(1.0, "the floor's coefficient, signed", minimum=-1.0, maximum=1.0)
    ceiling_reflection: float = parameter(1.0, "the ceiling's", minimum=-1.0, maximum=1.0)

    @property
    def storey(self) -> Storey:
        """The planes that there are."""
        planes = [(self.floor_m, self.floor_reflection), (self.ceiling_m, self.ceiling_reflection)]
        there = np.array([plane for plane in planes if plane[0] > 0.0]).reshape(-1, 2)
        return Storey(there[:, 0], there[:, 1])
