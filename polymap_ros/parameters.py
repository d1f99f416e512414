"""Every parameter once: name, default, unit, bounds, text, and whether it may change live.

The node declares its ROS parameters from here, the tools read the same YAML, and the documentation's tables are
made of it. A group is a frozen dataclass; `Parameters` is the tree of groups.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_type_hints

from polymap_ros.echo_parameters import EchoParameters
from polymap_ros.errors import ParameterError, UsageError
from polymap_ros.map_parameters import MOST_FREE_CELLS, FreeAreaParameters, GridParameters
from polymap_ros.names import suggestion
from polymap_ros.result_parameters import MapParameters, OutputParameters, TopicParameters
from polymap_ros.slam_parameters import SlamParameters
from polymap_ros.specification import Group, Specification, Value, parameter, specifications_of

NODE_NAME = 'polymap_node'

LEAST_CYCLES, MOST_CYCLES = 0.1, 1000.0
"""Of a pulse: its spectrum is a sum over as many times 64 samples at most."""


@dataclass(frozen=True)
class MediumParameters(Group):
    """The medium the sound travels in."""

    PREFIX = 'medium.'
    model: str = parameter('lamb_a0', 'dispersion: A0 Lamb wave of a plate, or a constant speed',
                           choices=('lamb_a0', 'constant'))
    thickness_m: float = parameter(0.006, 'plate thickness (lamb_a0)', unit='m', minimum=1e-5, maximum=1.0)
    longitudinal_speed_m_s: float = parameter(6149.0, 'longitudinal wave speed of the plate (lamb_a0)',
                                              unit='m/s', minimum=1.0, maximum=1e5)
    shear_speed_m_s: float = parameter(3097.0, 'shear wave speed of the plate (lamb_a0)', unit='m/s', minimum=1.0,
                                       maximum=1e5)
    speed_m_s: float = parameter(343.0, 'speed of sound (constant)', unit='m/s', minimum=1.0, maximum=1e5)
    spreading_exponent: float = parameter(
        -1.0, 'amplitude ~ distance**-exponent; negative: 0.5 for lamb_a0, 1.0 for constant', maximum=10.0)

    edge: str = parameter(
        'any', "what a reflection does to the phase; any: nothing, or where that does not explain the echoes an angle "
        "that is found; real: nothing, as in the paper; free: what a plate's free edge does, by the angle of incidence",
        choices=('any', 'real', 'free'))

    def check(self) -> None:
        if self.edge == 'free' and self.model != 'lamb_a0':
            raise ParameterError('medium.edge', f"{self.edge!r} is for medium.model 'lamb_a0'; found {self.model!r}")
        if self.model == 'lamb_a0' and self.shear_speed_m_s >= self.longitudinal_speed_m_s:
            raise ParameterError('medium.shear_speed_m_s',
                                 f'{self.shear_speed_m_s!r} is not below medium.longitudinal_speed_m_s '
                                 f'({self.longitudinal_speed_m_s!r})')

    @property
    def spreading(self) -> float:
        """The spreading exponent in force."""
        if self.spreading_exponent >= 0.0:
            return self.spreading_exponent
        return 0.5 if self.model == 'lamb_a0' else 1.0


@dataclass(frozen=True)
class PulseParameters(Group):
    """The emitted pulse s(t)."""

    PREFIX = 'pulse.'
    kind: str = parameter('tone_burst', 'shape of the pulse', choices=('tone_burst', 'chirp', 'file'))
    frequency_hz: float = parameter(100000.0, 'centre frequency', unit='Hz', minimum=1.0, maximum=1e9)
    cycles: float = parameter(2.0, 'length of the tone burst', unit='cycles', minimum=LEAST_CYCLES, maximum=MOST_CYCLES)
    window: str = parameter('hann', 'envelope of tone burst and chirp', choices=('hann', 'rectangular'))
    bandwidth_hz: float = parameter(0.0, 'width of the linear sweep about the centre (chirp)', unit='Hz', minimum=0.0,
                                    maximum=2e9)
    duration_s: float = parameter(0.0, 'length of the sweep (chirp)', unit='s', minimum=0.0, maximum=1000.0)
    path: str = parameter('', "recorded pulse, .npy or .wav at the echoes' sample rate (file)", is_path=True)
    adapt: str = parameter('auto', 'auto: where the echoes do not fit the pulse, the evidence solver looks for one '
                           'that they fit, of tone burst or chirp; off: it does not', choices=('auto', 'off'))

    def check(self) -> None:
        if self.kind == 'chirp':
            for name in ('bandwidth_hz', 'duration_s'):
                if getattr(self, name) <= 0.0:
                    raise ParameterError(f'pulse.{name}', f'{getattr(self, name)!r}; a chirp needs a value above 0')
            if self.bandwidth_hz >= 2.0 * self.frequency_hz:
                raise ParameterError('pulse.bandwidth_hz', f'{self.bandwidth_hz!r} reaches below 0 Hz; allowed: '
                                     f'below twice pulse.frequency_hz ({self.frequency_hz!r})')
            if not LEAST_CYCLES <= (cycles := self.duration_s * self.frequency_hz) <= MOST_CYCLES:
                raise ParameterError('pulse.duration_s', f'{self.duration_s!r} makes {cycles:.3g} cycles of '
                                     f'pulse.frequency_hz ({self.frequency_hz!r}); allowed: {LEAST_CYCLES:g} to '
                                     f'{MOST_CYCLES:g}')


@dataclass(frozen=True)
class FrontEndParameters(Group):
    """What is done to the samples before eq. (3)."""

    PREFIX = 'front_end.'
    max_bad: float = parameter(
        1.0, 'a ping of which a larger share of samples beyond the blanking is clipped or dropped out is dropped as '
        'bad_samples; 1: none', minimum=0.0, maximum=1.0)
    common_pings: int = parameter(
        0, 'pings at different places that what all pings have in common (direct wave, body, ceiling) is found from '
        'and taken out; pings wait until so many are there; 0: off', minimum=0, maximum=256)
    remove_dc: bool = parameter(
        False, 'take the mean out of every ping; false: only an offset of rf, or a floor of magnitudes, which is told')
    band_low_hz: float = parameter(0.0, 'frequencies below this are taken out; 0: none', unit='Hz', minimum=0.0,
                                   maximum=1e9)
    band_high_hz: float = parameter(0.0, 'frequencies above this are taken out; 0: none', unit='Hz', minimum=0.0,
                                    maximum=1e9)
    mute_blanking: bool = parameter(False, 'silence the samples before an echo from the end of the blanking begins')
    gain_db_s: float = parameter(0.0, 'gain that grows with the time after emission, to undo what the device does',
                                 unit='dB/s', minimum=-1e7, maximum=1e7)
    filter: str = parameter('matched', 'eq. (3), or deconvolution by the expected echo, which is sharper and noisier',
                            choices=('matched', 'wiener'))
    wiener_noise: float = parameter(0.1, "noise over the expected echo's strongest power, frequency by frequency "
                                    '(wiener)', minimum=1e-6, maximum=1e6)
    flat_spreading: bool = parameter(False, 'make up for spreading in the beamforming map, which then shows far walls '
                                     'as bright as near ones, and far noise, too')

    def check(self) -> None:
        if 0 < self.common_pings < 8:
            raise ParameterError('front_end.common_pings', f'{self.common_pings!r} pings cannot tell; allowed: 0, or '
                                 'at least 8')
        for name in ('band_low_hz', 'band_high_hz'):
            if 0.0 < getattr(self, name) < 1e-3:
                raise ParameterError(f'front_end.{name}', f'{getattr(self, name)!r} is slower than any ping; allowed: '
                                     '0, or at least 1e-3')
        if self.band_high_hz and self.band_low_hz >= self.band_high_hz:
            raise ParameterError('front_end.band_low_hz', f'{self.band_low_hz!r} is not below front_end.band_high_hz '
                                 f'({self.band_high_hz!r})')


@dataclass(frozen=True)
class SensorParameters(Group):
    """The sensor in the robot's base frame."""

    PREFIX = 'sensor.'
    x_m: float = parameter(0.0, "sensor in the robot's base frame, forward", unit='m', minimum=-1000.0, maximum=1000.0)
    y_m: float = parameter(0.0, "sensor in the robot's base frame, left", unit='m', minimum=-1000.0, maximum=1000.0)
    from_tf: bool = parameter(
        False, "take TF's place of the echo's frame_id in the odometry's child_frame_id instead of x_m and y_m (needs "
        'tf2_ros; in a recording /tf_static)')
    baseline_x_m: float = parameter(0.0, 'from emitter to receiver, forward; the sensor is half way between them',
                                    unit='m', minimum=-1000.0, maximum=1000.0)
    baseline_y_m: float = parameter(0.0, 'from emitter to receiver, left', unit='m', minimum=-1000.0, maximum=1000.0)
    baseline_z_m: float = parameter(0.0, 'from emitter to receiver, up', unit='m', minimum=-1000.0, maximum=1000.0)

    def check(self) -> None:
        for name in ('x_m', 'y_m'):
            if self.from_tf and getattr(self, name) != 0.0:
                raise ParameterError(f'sensor.{name}', f'{getattr(self, name)!r} says what sensor.from_tf takes from '
                                     'TF; allowed with it: 0.0')

    @property
    def baseline_m(self) -> float:
        """Distance between emitter and receiver [m]."""
        return math.hypot(self.baseline_x_m, self.baseline_y_m, self.baseline_z_m)


@dataclass(frozen=True)
class OdometryParameters(Group):
    """How poses are taken from the odometry."""

    PREFIX = 'odometry.'
    max_gap_s: float = parameter(1.0, 'a longer gap between two odometry messages is not interpolated across',
                                 unit='s', above=0.0, maximum=1e9)
    buffer_s: float = parameter(60.0, 'poses kept for pings that come late', unit='s', above=0.0, maximum=3600.0)
    queue_size: int = parameter(200, 'pings that may wait for their odometry', minimum=1, maximum=10_000)
    plane: str = parameter(
        'xy', "plane that is mapped: the odometry's xy plane, or that of the robot's x and y axes at the first pose, "
        'such as a plate that stands upright', choices=('xy', 'first_pose'))
    max_tilt_deg: float = parameter(10.0, 'a ping of a robot tilted more than this off the plane is dropped as '
                                    'off_plane; at 10 deg walls seem 1.5 % farther', unit='deg', minimum=0.0,
                                    maximum=180.0)
    max_height_m: float = parameter(0.1, 'so is one of a robot lifted or lowered more than this from where it was on '
                                    'the plane at the first pose', unit='m', minimum=0.0, maximum=1e9)
    scale: float = parameter(1.0, 'reported over true distance; poses are freed of it', minimum=1e-3, maximum=1e3)
    yaw_drift_deg_m: float = parameter(
        0.0, 'turn of the reported heading per true metre travelled, counter-clockwise; poses are freed of it',
        unit='deg/m', minimum=-3600.0, maximum=3600.0)
    on_jump_back: str = parameter(
        'reset', 'when /clock or odometry goes back by more than max_gap_s (bag loop): forget the map, or ignore '
        'what is older than the newest odometry (node)', choices=('reset', 'ignore'), live=True)


@dataclass(frozen=True)
class SolverParameters(Group):
    """The search for the polygon."""

    PREFIX = 'solver.'
    method: str = parameter('evidence', 'how the polygon is found', choices=('evidence', 'paper', 'rectangle'),
                            live=True)
    max_edges: int = parameter(10, 'K, upper bound of the number of edges', minimum=3, maximum=64, live=True)
    outline: str = parameter('auto', 'auto: outlines that are not convex are looked for where no convex one explains '
                             'the echoes; convex: they are not', choices=('auto', 'convex'), live=True)
    period_s: float = parameter(1.0, 'time between two solves of the node', unit='s', minimum=1e-3, maximum=1e6,
                                live=True)
    seed: int = parameter(1, 'seed of the one random generator', minimum=0, maximum=2**63 - 1, live=True)
    iterations: int = parameter(300, 'iterations of the annealing (paper)', minimum=1, maximum=1_000_000, live=True)
    iou_weight: float = parameter(3.0, 'lambda of eq. (5) (paper)', minimum=0.0, maximum=1e6, live=True)
    edge_filter_epsilon: float = parameter(0.01, 'epsilon of eq. (10) (paper)', minimum=0.0, maximum=1e6, live=True)
    neighbourhood_m: float = parameter(0.054, 'size in r of the neighbourhood V of eq. (8) (paper)', unit='m',
                                       minimum=0.0, maximum=1e3, live=True)
    neighbourhood_deg: float = parameter(48.0, 'size in theta of the neighbourhood V of eq. (8) (paper)',
                                         unit='deg', minimum=0.0, maximum=360.0, live=True)


@dataclass(frozen=True)
class Parameters:
    """All parameters of polymap_ros; immutable, validated on construction.

    `of` and `replaced` take values by name, ``parameters['solver.seed']`` gives one back.

    Parameters
    ----------
    medium, pulse, echo, front_end, sensor, odometry, grid, free_area, solver, slam, map, output, topics : groups
        Each with the parameters of that name.

    Raises
    ------
    ParameterError
        From the group whose value is not allowed.
    """

    medium: MediumParameters = field(default_factory=MediumParameters)
    pulse: PulseParameters = field(default_factory=PulseParameters)
    echo: EchoParameters = field(default_factory=EchoParameters)
    front_end: FrontEndParameters = field(default_factory=FrontEndParameters)
    sensor: SensorParameters = field(default_factory=SensorParameters)
    odometry: OdometryParameters = field(default_factory=OdometryParameters)
    grid: GridParameters = field(default_factory=GridParameters)
    free_area: FreeAreaParameters = field(default_factory=FreeAreaParameters)
    solver: SolverParameters = field(default_factory=SolverParameters)
    slam: SlamParameters = field(default_factory=SlamParameters)
    map: MapParameters = field(default_factory=MapParameters)
    output: OutputParameters = field(default_factory=OutputParameters)
    topics: TopicParameters = field(default_factory=TopicParameters)
    folder: Path = field(default=Path(), compare=False)
    """What relative file names in the parameters are relative to: the YAML's folder."""

    def __post_init__(self) -> None:
        for group in _GROUPS:
            if not isinstance(getattr(self, group), Group):
                raise ParameterError(group, f'{getattr(self, group)!r:.80} is no group of parameters; '
                                     f"Parameters.of({group}={{...}}) takes a mapping")
        medium, grid, area = self.medium, self.grid, self.free_area
        wavelengths = self.pulse.frequency_hz * medium.thickness_m / medium.shear_speed_m_s
        if medium.model == 'lamb_a0' and not 1e-4 <= wavelengths <= 100.0:
            raise ParameterError('medium.thickness_m', f'{medium.thickness_m!r} is {wavelengths:.3g} wavelengths of '
                                 f'shear waves at pulse.frequency_hz ({self.pulse.frequency_hz!r}); allowed: 1e-4 to '
                                 '100')
        if self.slam.map_origin != 'odom' and self.odometry.plane != 'xy':
            raise ParameterError('slam.map_origin', f'{self.slam.map_origin!r} is for odometry.plane xy; the '
                                 f'coordinates of {self.odometry.plane!r} begin where the robot does')
        across = 2.0 * grid.range_max_m / (area.cell_m or 2.0 * grid.range_step_m)
        if area.model == 'grid' and (cells := across * across) > MOST_FREE_CELLS:
            raise ParameterError('free_area.cell_m', f'{area.cell_m!r} makes a grid of {cells:.3g} cells within '
                                 f'grid.range_max_m; allowed: up to {MOST_FREE_CELLS:.0e}')

    @classmethod
    def of(cls, given: Mapping[str, Any] = MappingProxyType({}), /, **groups: Any) -> 'Parameters':
        """Return the defaults changed, as in ``of(medium={'model': 'constant'})`` or ``of({'solver.seed': 2})``.

        Raises
        ------
        ParameterError
            As `replaced` does, and for a group that is no mapping.
        """
        if not isinstance(given, Mapping):
            raise UsageError(f"{given!r:.80}: must be a mapping such as {{'solver.seed': 2}}")
        values: dict[str, object] = {}
        for group, entries in {**given, **groups}.items():
            if group not in _BY_NAME and group not in _GROUPS:
                raise ParameterError(str(group), f'unknown; {suggestion(str(group), [*_GROUPS, *_BY_NAME])}')
            if group not in _BY_NAME and not isinstance(entries, Mapping):
                raise ParameterError(group, f"{entries!r} is no mapping such as medium={{'model': 'constant'}}")
            values |= {group: entries} if group in _BY_NAME else {f'{group}.{key}': entries[key] for key in entries}
        return cls().replaced(values)

    def __repr__(self) -> str:
        groups: dict[str, dict[str, Value]] = {}
        for spec in specifications():
            group, _, name = spec.name.partition('.')
            if self[spec.name] != spec.default:
                groups.setdefault(group, {})[name] = self[spec.name]
        return f'Parameters.of({", ".join(f"{group}={entries!r}" for group, entries in groups.items())})'

    def flat(self) -> dict[str, Value]:
        """All values by full name, in declaration order."""
        return {spec.name: self[spec.name] for spec in specifications()}

    @property
    def localises(self) -> bool:
        """Whether only poses are looked for, in an outline that is given."""
        return self.slam.mode == 'localization' and self.solver.method == 'evidence'

    def __getitem__(self, name: str) -> Value:
        group, _, key = name.partition('.')
        value: Value = getattr(getattr(self, group), key)
        return value

    def replaced(self, values: Mapping[str, object]) -> 'Parameters':
        """Return a copy with the named values changed.

        Raises
        ------
        ParameterError
            For an unknown name, a wrong type or a value that is not allowed.
        """
        groups: dict[str, dict[str, object]] = {}
        for name, value in values.items():
            if name not in _BY_NAME:
                raise ParameterError(name, f'unknown; {suggestion(name, list(_BY_NAME))}')
            group, _, key = name.partition('.')
            groups.setdefault(group, {})[key] = _BY_NAME[name].check(value)
        changed: dict[str, Any] = {
            group: dataclasses.replace(getattr(self, group), **entries) for group, entries in groups.items()
        }
        return dataclasses.replace(self, **changed)


def specifications() -> list[Specification]:
    """All parameters, in declaration order."""
    return list(_BY_NAME.values())


_GROUPS = {name: kind for name, kind in get_type_hints(Parameters).items() if issubclass(kind, Group)}
_BY_NAME = {spec.name: spec for name, group in _GROUPS.items() for spec in specifications_of(group, f'{name}.')}
