"""The parameters of what is written and read: the occupancy map, folders, a recording's topics."""

from dataclasses import dataclass

from polymap_ros.errors import ParameterError
from polymap_ros.specification import Group, parameter


@dataclass(frozen=True)
class MapParameters(Group):
    """The occupancy map."""

    PREFIX = 'map.'
    resolution_m: float = parameter(0.0, 'cell size of the occupancy map; 0: grid.range_step_m, or larger where the '
                                    'place would not fit', unit='m', minimum=0.0, maximum=1e3, live=True)
    margin_m: float = parameter(0.1, 'free border around the polygon in the occupancy map', unit='m', minimum=0.0,
                                maximum=1e3, live=True)

    def check(self) -> None:
        if 0.0 < self.resolution_m < 1e-6:
            raise ParameterError('map.resolution_m', f'{self.resolution_m!r} is finer than any map; allowed: 0, or at '
                                 'least 1e-6')


@dataclass(frozen=True)
class OutputParameters(Group):
    """Where results go."""

    PREFIX = 'output.'
    dir: str = parameter('polymap', "folder of the node's saved maps", is_path=True)
    autosave_s: float = parameter(0.0, 'time between automatic saves; 0: none', unit='s', minimum=0.0, maximum=1e6,
                                  live=True)
    load_path: str = parameter(
        '', 'state.npz to continue from, or its folder; odometry that begins before it is taken for that of another '
        'clock, or left out with odometry.on_jump_back: ignore. With slam.mode: localization the folder of a saved '
        'map, or a polygon.json', is_path=True)


@dataclass(frozen=True)
class TopicParameters(Group):
    """Topics of a recording; read-only, live remap instead."""

    PREFIX = 'topics.'
    odom: str = parameter('odom', 'odometry topic in a recording (live: remap)')
    echo: str = parameter('echo', 'echo topic in a recording (live: remap)')
