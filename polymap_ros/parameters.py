"""Every parameter once: name, default, unit, bounds, text, and whether it may change live.

The node declares its ROS parameters from here, the tools read the same YAML, and the README's table is
tested against it. A group is a frozen dataclass; `Parameters` is the tree of groups.
"""

import dataclasses
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, TypeAlias, get_type_hints

import yaml

from polymap_ros.errors import ParameterError

Value: TypeAlias = bool | int | float | str

NODE_NAME = 'polymap_node'


def parameter(
    default: Value,
    text: str,
    *,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    above: float | None = None,
    choices: tuple[str, ...] = (),
    live: bool = False,
) -> Any:
    """Describe one parameter; `above` is an open lower bound, `live` allows a change while the node runs."""
    return field(
        default=default,
        metadata={
            'default': default, 'text': text, 'unit': unit, 'minimum': minimum, 'maximum': maximum, 'above': above,
            'choices': choices, 'live': live,
        },
    )


@dataclass(frozen=True)
class Specification:
    """What is known of one parameter, for descriptors and tables."""

    name: str
    type: type
    default: Value
    text: str
    unit: str
    minimum: float | None
    maximum: float | None
    above: float | None
    choices: tuple[str, ...]
    live: bool

    def check(self, value: object) -> Value:
        """Return `value` in the parameter's type, or raise `ParameterError` with what is allowed."""
        if self.type is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if not isinstance(value, (bool, int, float, str)) or type(value) is not self.type:
            raise ParameterError(
                self.name, f'{value!r} is of type {type(value).__name__}; allowed: {self.allowed()}'
            )
        if self.choices and value not in self.choices:
            raise ParameterError(self.name, f'{value!r} is not known; allowed: {self.allowed()}')
        if isinstance(value, (int, float)) and not isinstance(value, bool) and not self._within(value):
            raise ParameterError(self.name, f'{value!r} is out of range; allowed: {self.allowed()}')
        return value

    def _within(self, value: float) -> bool:
        return (
            math.isfinite(value)
            and (self.minimum is None or value >= self.minimum)
            and (self.above is None or value > self.above)
            and (self.maximum is None or value <= self.maximum)
        )

    def allowed(self) -> str:
        """Say in words what the parameter takes, such as ``double in (0, 100] m``."""
        if self.choices:
            return ' | '.join(self.choices)
        kind = {float: 'double', int: 'integer', bool: 'bool', str: 'string'}[self.type]
        low, high = self.above if self.above is not None else self.minimum, self.maximum
        if low is None and high is None:
            return f'{kind} {self.unit}'.strip()
        left = '(-inf' if low is None else f'{"(" if self.above is not None else "["}{low:g}'
        right = 'inf)' if high is None else f'{high:g}]'
        return f'{kind} in {left}, {right} {self.unit}'.strip()


def _specifications(group: type['Group'], prefix: str) -> Iterator[Specification]:
    for entry in dataclasses.fields(group):
        if 'text' in entry.metadata:
            kind = type(entry.metadata['default'])
            yield Specification(name=prefix + entry.name, type=kind, **entry.metadata)


@dataclass(frozen=True)
class Group:
    """Base of the parameter groups: checks every value against its specification when constructed."""

    PREFIX: ClassVar[str] = ''

    def __post_init__(self) -> None:
        for spec in _specifications(type(self), self.PREFIX):
            name = spec.name.removeprefix(self.PREFIX)
            object.__setattr__(self, name, spec.check(getattr(self, name)))
        self.check()

    def check(self) -> None:
        """Check what involves several values of the group; raises `ParameterError`."""


@dataclass(frozen=True)
class MediumParameters(Group):
    """The medium the sound travels in."""

    PREFIX = 'medium.'
    model: str = parameter('lamb_a0', 'dispersion: A0 Lamb wave of a plate, or a constant speed',
                           choices=('lamb_a0', 'constant'))
    thickness_m: float = parameter(0.006, 'plate thickness (lamb_a0)', unit='m', above=0.0)
    longitudinal_speed_m_s: float = parameter(6149.0, 'longitudinal wave speed of the plate (lamb_a0)',
                                              unit='m/s', above=0.0)
    shear_speed_m_s: float = parameter(3097.0, 'shear wave speed of the plate (lamb_a0)', unit='m/s', above=0.0)
    speed_m_s: float = parameter(343.0, 'speed of sound (constant)', unit='m/s', above=0.0)
    spreading_exponent: float = parameter(
        -1.0, 'amplitude ~ distance**-exponent; negative: 0.5 for lamb_a0, 1.0 for constant', maximum=10.0)

    def check(self) -> None:
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
    frequency_hz: float = parameter(100000.0, 'centre frequency', unit='Hz', above=0.0)
    cycles: float = parameter(2.0, 'length of the tone burst', unit='cycles', above=0.0)
    window: str = parameter('hann', 'envelope of tone burst and chirp', choices=('hann', 'rectangular'))
    bandwidth_hz: float = parameter(0.0, 'width of the linear sweep about the centre (chirp)', unit='Hz',
                                    minimum=0.0)
    duration_s: float = parameter(0.0, 'length of the sweep (chirp)', unit='s', minimum=0.0)
    path: str = parameter('', "recorded pulse, .npy or .wav at the echoes' sample rate (file)")

    def check(self) -> None:
        if self.kind == 'chirp':
            for name in ('bandwidth_hz', 'duration_s'):
                if getattr(self, name) <= 0.0:
                    raise ParameterError(f'pulse.{name}', f'{getattr(self, name)!r}; a chirp needs a value above 0')
            if self.bandwidth_hz >= 2.0 * self.frequency_hz:
                raise ParameterError('pulse.bandwidth_hz', f'{self.bandwidth_hz!r} reaches below 0 Hz; allowed: '
                                     f'below twice pulse.frequency_hz ({self.frequency_hz!r})')
        if self.kind == 'file' and not self.path:
            raise ParameterError('pulse.path', "'' names no file; pulse.kind 'file' needs a .npy or .wav")


@dataclass(frozen=True)
class EchoParameters(Group):
    """The echo messages."""

    PREFIX = 'echo.'
    type: str = parameter('sensor_msgs/msg/LaserScan', 'message type of the echo topic', choices=(
        'sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/PointCloud2', 'sensor_msgs/msg/Image',
        'std_msgs/msg/Float32MultiArray'))
    kind: str = parameter('rf', 'samples are the signed signal (rf) or its magnitude (envelope)',
                          choices=('rf', 'envelope'))
    t0_s: float = parameter(0.0, 'time of the first sample after emission', unit='s')
    sample_period_s: float = parameter(0.0, 'sample period; 0: from the message', unit='s', minimum=0.0)
    blanking_m: float = parameter(0.02, 'no echo is looked for nearer than this', unit='m', minimum=0.0)
    allow_unstamped: bool = parameter(False, 'take Float32MultiArray, stamped on arrival')

    def check(self) -> None:
        if self.type.endswith(('/Image', '/Float32MultiArray')) and self.sample_period_s <= 0.0:
            raise ParameterError('echo.sample_period_s', f'{self.type} has no sample period; allowed: above 0')
        if self.type.endswith('/Float32MultiArray') and not self.allow_unstamped:
            raise ParameterError('echo.allow_unstamped', f'{self.type} has no stamp; true takes it, stamped on arrival')


@dataclass(frozen=True)
class SensorParameters(Group):
    """The sensor in the robot's base frame."""

    PREFIX = 'sensor.'
    x_m: float = parameter(0.0, "sensor in the robot's base frame, forward", unit='m')
    y_m: float = parameter(0.0, "sensor in the robot's base frame, left", unit='m')


@dataclass(frozen=True)
class OdometryParameters(Group):
    """How poses are taken from the odometry."""

    PREFIX = 'odometry.'
    max_gap_s: float = parameter(1.0, 'a longer gap between two odometry messages is not interpolated across',
                                 unit='s', above=0.0)
    buffer_s: float = parameter(60.0, 'poses kept for pings that come late', unit='s', above=0.0)
    queue_size: int = parameter(200, 'pings that may wait for their odometry', minimum=1)
    on_jump_back: str = parameter(
        'reset', 'when /clock goes back, or odometry by more than max_gap_s (bag loop): forget the map, or ignore '
        'what is older than the newest odometry (node)', choices=('reset', 'ignore'), live=True)


@dataclass(frozen=True)
class GridParameters(Group):
    """The beamforming map's axes (r, theta) and the range axis of the envelopes."""

    PREFIX = 'grid.'
    range_max_m: float = parameter(3.0, 'end of the range axis', unit='m', above=0.0)
    range_step_m: float = parameter(0.005, 'step of the range axis', unit='m', above=0.0)
    angle_step_deg: float = parameter(1.0, 'step of the angle axis', unit='deg', above=0.0, maximum=90.0)
    angle_min_deg: float = parameter(0.0, 'start of the angle axis', unit='deg', minimum=-360.0, maximum=360.0)
    angle_max_deg: float = parameter(360.0, 'end of the angle axis, exclusive', unit='deg',
                                     minimum=-360.0, maximum=720.0)

    def check(self) -> None:
        if self.range_step_m > self.range_max_m / 2:
            raise ParameterError('grid.range_step_m',
                                 f'{self.range_step_m!r} leaves fewer than three ranges up to grid.range_max_m '
                                 f'({self.range_max_m!r})')
        span = self.angle_max_deg - self.angle_min_deg
        if not 0.0 < span <= 360.0:
            raise ParameterError('grid.angle_max_deg', f'{self.angle_max_deg!r} is not above grid.angle_min_deg '
                                 f'({self.angle_min_deg!r}) by at most 360')
        cells = (self.range_max_m / self.range_step_m) * (span / self.angle_step_deg)
        if cells > 1e8:
            raise ParameterError('grid.range_step_m', f'the map would have {cells:.3g} cells; allowed: up to 1e8')


@dataclass(frozen=True)
class SolverParameters(Group):
    """The search for the polygon."""

    PREFIX = 'solver.'
    method: str = parameter('evidence', 'how the polygon is found', choices=('evidence', 'paper', 'rectangle'),
                            live=True)
    max_edges: int = parameter(10, 'K, upper bound of the number of edges', minimum=3, maximum=64, live=True)
    period_s: float = parameter(1.0, 'time between two solves of the node', unit='s', above=0.0, live=True)
    seed: int = parameter(1, 'seed of the one random generator', minimum=0, live=True)
    iterations: int = parameter(300, 'iterations of the annealing (paper)', minimum=1, live=True)
    iou_weight: float = parameter(3.0, 'lambda of eq. (5) (paper)', minimum=0.0, live=True)
    edge_filter_epsilon: float = parameter(0.01, 'epsilon of eq. (10) (paper)', minimum=0.0, live=True)
    neighbourhood_m: float = parameter(0.054, 'size in r of the neighbourhood V of eq. (8) (paper)', unit='m',
                                       minimum=0.0, live=True)
    neighbourhood_deg: float = parameter(48.0, 'size in theta of the neighbourhood V of eq. (8) (paper)',
                                         unit='deg', minimum=0.0, maximum=360.0, live=True)


@dataclass(frozen=True)
class MapParameters(Group):
    """The occupancy map."""

    PREFIX = 'map.'
    resolution_m: float = parameter(0.0, 'cell size of the occupancy map; 0: grid.range_step_m', unit='m',
                                    minimum=0.0, live=True)
    margin_m: float = parameter(0.1, 'free border around the polygon in the occupancy map', unit='m',
                                minimum=0.0, live=True)


@dataclass(frozen=True)
class OutputParameters(Group):
    """Where results go."""

    PREFIX = 'output.'
    dir: str = parameter('polymap', "folder of the node's saved maps")
    autosave_s: float = parameter(0.0, 'time between automatic saves; 0: none', unit='s', minimum=0.0, live=True)
    load_path: str = parameter('', 'state.npz to continue from')


@dataclass(frozen=True)
class TopicParameters(Group):
    """Topics of a recording; read-only, live remap instead."""

    PREFIX = 'topics.'
    odom: str = parameter('odom', 'odometry topic in a recording (live: remap)')
    echo: str = parameter('echo', 'echo topic in a recording (live: remap)')


@dataclass(frozen=True)
class Parameters:
    """All parameters of polymap_ros; immutable, validated on construction.

    Raises
    ------
    ParameterError
        From the group whose value is not allowed.
    """

    medium: MediumParameters = field(default_factory=MediumParameters)
    pulse: PulseParameters = field(default_factory=PulseParameters)
    echo: EchoParameters = field(default_factory=EchoParameters)
    sensor: SensorParameters = field(default_factory=SensorParameters)
    odometry: OdometryParameters = field(default_factory=OdometryParameters)
    grid: GridParameters = field(default_factory=GridParameters)
    solver: SolverParameters = field(default_factory=SolverParameters)
    map: MapParameters = field(default_factory=MapParameters)
    output: OutputParameters = field(default_factory=OutputParameters)
    topics: TopicParameters = field(default_factory=TopicParameters)
    folder: Path = field(default=Path(), compare=False)
    """What relative file names in the parameters are relative to: the YAML's folder."""

    def flat(self) -> dict[str, Value]:
        """All values by full name, in declaration order."""
        return {spec.name: self[spec.name] for spec in specifications()}

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
                raise ParameterError(name, f'unknown; {_suggestion(name)}')
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
_BY_NAME = {spec.name: spec for name, group in _GROUPS.items() for spec in _specifications(group, f'{name}.')}


def _suggestion(name: str) -> str:
    import difflib

    group = name.partition('.')[0]
    known = [other for other in _BY_NAME if other.startswith(f'{group}.')] or list(_BY_NAME)
    close = difflib.get_close_matches(name, known, n=1)
    return f'did you mean {close[0]}?' if close else f'known: {", ".join(known)}'


class _Loader(yaml.SafeLoader):
    """YAML as ROS reads it: 1e-6 is a number, as in YAML 1.2, where PyYAML's 1.1 asks for 1.0e-6."""


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$'), list('-+.0123456789'))


def _read_yaml(text: str) -> Any:
    return yaml.load(text, Loader=_Loader)


def parse_override(text: str) -> tuple[str, object]:
    """Split a command line's ``name:=value``; the value is read as YAML, as ROS does."""
    name, separator, value = text.partition(':=')
    if not separator or not name:
        raise ParameterError(text, 'expected name:=value')
    try:
        return name, _read_yaml(value) if value else ''
    except yaml.YAMLError as error:
        raise ParameterError(name, f'{value!r} is not a YAML value') from error


def load_parameters(
    path: Path, overrides: Mapping[str, object] | None = None, node_name: str = NODE_NAME
) -> Parameters:
    """Read a ROS parameter file, and then `overrides` as of a command line; the result is checked as a whole.

    Keys ``/**``, ``node_name`` and ``/ns/node_name`` (or nested, ``ns: node_name:``) are taken, the most specific last.
    Unknown names below ``/**`` belong to other nodes and are left alone, and so are names outside our groups
    (``use_sim_time``).

    Raises
    ------
    ParameterError
        For a file that cannot be read, is not a parameter file, or holds a name or value not allowed.
    """
    try:
        document = _read_yaml(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise ParameterError(str(path), f'cannot be read: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParameterError(str(path), f'is not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(document, dict):
        raise ParameterError(str(path), 'is not a ROS parameter file: expected polymap_node: ros__parameters: ...')
    nodes = dict(_nodes(document, node_name))
    keys = [key for key in nodes if key == '/**' or key.rpartition('/')[2] == node_name]
    if not keys:
        raise ParameterError(str(path), f'has no {node_name} or /** key, only {", ".join(map(str, document))}')
    values: dict[str, object] = {}
    for key in sorted(keys, key=lambda key: (key != '/**', key.count('/'), key)):
        body = nodes[key].get('ros__parameters') if isinstance(nodes[key], dict) else None
        if not isinstance(body, dict):
            raise ParameterError(str(path), f'{key} has no ros__parameters')
        entries = _flattened(body)
        if key == '/**':
            entries = {name: value for name, value in entries.items() if name in _BY_NAME}
        values |= {name: value for name, value in entries.items() if name.partition('.')[0] in _GROUPS}
    loaded = Parameters().replaced(values | dict(overrides or {}))
    return dataclasses.replace(loaded, folder=path.resolve().parent)


def _nodes(tree: Mapping[Any, Any], node_name: str, prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Full name and body of every node; any other key that holds keys is a namespace."""
    for key, body in tree.items():
        name = f'{prefix}/{key}' if prefix else str(key)
        if isinstance(body, dict) and 'ros__parameters' not in body and str(key) not in (node_name, '/**'):
            yield from _nodes(body, node_name, name)
        else:
            yield name, body


def _flattened(tree: Mapping[Any, Any], prefix: str = '') -> dict[str, object]:
    flat: dict[str, object] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat |= _flattened(value, f'{prefix}{key}.')
        else:
            flat[f'{prefix}{key}'] = value
    return flat
