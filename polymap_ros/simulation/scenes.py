"""A scene to simulate: the room, the path, the device and what disturbs it."""

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.echo_parameters import EchoParameters
from polymap_ros.errors import SceneError
from polymap_ros.map_parameters import GridParameters
from polymap_ros.parameters import MediumParameters, Parameters, PulseParameters, SensorParameters
from polymap_ros.simulation.clearance import clearance
from polymap_ros.simulation.corners import counter_clockwise
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.height import Height
from polymap_ros.simulation.inside import Hole, Partition, RoundHole, check_apart, holes_of, partitions_of
from polymap_ros.simulation.interference import coloured
from polymap_ros.simulation.odometry import LEVELS, Drift, reported, with_slips
from polymap_ros.simulation.propagation import Propagation
from polymap_ros.simulation.reflectors import Reflectors

MOST_PINGS, MOST_SAMPLES, MOST_ODOMETRY = 200_000, 2**30, 10_000_000
"""Pings, samples of all of them, and messages of odometry that a scene may have: slips are told by name."""

MOST_SEQUENCES = 1e10
"""Sequences of walls, of all pings, tried where a scene has holes or inner walls: a quarter of an hour's work."""

FARTHEST_M, LAST_S = 1e9, 2.0**31 - 1.0
"""As far as the mapper takes poses, and as late as a stamp can be."""

_BOUNDS = {
    'sample_rate_hz': (1e-3, 1e12), 'n_samples': (1, 2**20), 'order': (1, 64), 'seed': (0, 2**63 - 1),
    'ping_period_s': (1e-9, 1e6), 'odometry_rate_hz': (1e-6, 1e9), 'gain_range_db': (0.0, 300.0),
    'position_noise_m': (0.0, 1e6), 't0_s': (-100.0, 100.0), 'snr_db': (-300.0, 300.0)}
"""Beyond these the samples would be no numbers, the stamps none of ROS, or the work without end."""

EDGE_FADINGS = 'none', 'fresnel'
"""What echoes may do at the ends of walls."""

ECHO_KINDS = 'rf', 'envelope'
"""What a device may give of the signal, as `echo.kind` of the parameters has it."""

_GAIN_STREAM, _POSITION_STREAM, _NOISE_STREAM, _DRIFT_STREAM = 1, 2, 3, 8


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything the simulator needs; the same scene gives the same samples.

    Parameters
    ----------
    name : str
        Name, for tables and files.
    vertices : array_like, shape (n, 2)
        Corners of the outline, a simple polygon [m], in the odometry's frame, in either direction; kept
        counter-clockwise.
    poses : array_like, shape (T, 3)
        True poses of the robot's base at the pings: x, y [m], yaw [rad]; emitter and receiver are always inside.
    medium, pulse, sensor, grid : parameter groups
        As for the mapper; `parameters` hands them on.
    told_medium : MediumParameters, optional
        What the mapper is told instead of `medium`, where it is to be wrong.
    faults : Faults
        What device and odometry do wrong.
    edges : Edges
        What a reflection does beside taking some of it.
    propagation : Propagation
        What the medium does that `medium` does not say.
    edge_fading : str
        What echoes do at the ends of walls: none, they end at once, as image sources do; fresnel, they fade over a
        Fresnel zone, and corners echo, by the uniform theory of diffraction at the pulse's frequency. Not at the ends
        of inner walls.
    height : Height
        Floor and ceiling, of a room.
    holes : sequence of Hole or RoundHole, or of array_like, shape (k, 2)
        Holes inside the outline, or by their corners [m] in either direction; they meet neither it nor one another.
    inner_walls : sequence of Partition
        Walls inside that let some of the wave through; what of one is outside or in a hole is not there. With any of
        these or with holes, echoes are those of every sequence of walls.
    sample_rate_hz : float
        Sample rate [Hz].
    n_samples : int
        Samples per ping.
    t0_s : float
        Time of the first sample after emission [s].
    echo_kind : str
        What the device gives: rf, the signal; envelope, the magnitude of its analytic signal, noise included.
    snr_db : float or None
        Ratio of the mean power of a ping's noise-free samples to the noise power [dB]; None: no noise.
    order : int
        Highest order of the image sources.
    reflection : array_like, shape (n,), or float
        Reflection coefficient of each edge, signed; edge i runs from vertex i to vertex i + 1.
    seed : int
        Seed of noise, gains and position errors, which are drawn from streams of their own.
    ping_period_s : float
        Time between two pings [s].
    odometry_rate_hz : float
        Rate of the odometry in a recording [Hz].
    gain_range_db : float
        The echoes' gain is uniform in +-half of this [dB], ping by ping, while the noise keeps its power.
    position_noise_m : float
        Standard deviation of the reported x and of the reported y at a ping [m].
    recorded_pulse : ndarray, shape (k,), optional
        Samples of ``pulse.kind: file``, which it implies, at the scene's sample rate.
    """

    name: str
    vertices: NDArray[np.float64]
    poses: NDArray[np.float64]
    medium: MediumParameters = field(default_factory=MediumParameters)
    pulse: PulseParameters = field(default_factory=PulseParameters)
    sensor: SensorParameters = field(default_factory=SensorParameters)
    grid: GridParameters = field(default_factory=GridParameters)
    sample_rate_hz: float = 1e6
    n_samples: int = 2048
    t0_s: float = 0.0
    echo_kind: str = 'rf'
    snr_db: float | None = 0.0
    order: int = 5
    reflection: ArrayLike = 1.0
    seed: int = 1
    ping_period_s: float = 0.5
    odometry_rate_hz: float = 20.0
    gain_range_db: float = 0.0
    position_noise_m: float = 0.0
    recorded_pulse: NDArray[np.float64] | None = None
    told_medium: MediumParameters | None = None
    faults: Faults = field(default_factory=Faults)
    edges: Edges = field(default_factory=Edges)
    propagation: Propagation = field(default_factory=Propagation)
    edge_fading: str = 'none'
    height: Height = field(default_factory=Height)
    holes: tuple[Hole | RoundHole, ...] = ()
    inner_walls: tuple[Partition, ...] = ()

    def __post_init__(self) -> None:
        if self.recorded_pulse is not None:
            object.__setattr__(self, 'pulse', dataclasses.replace(self.pulse, kind='file'))
        vertices, reflection = counter_clockwise(self.vertices, self.reflection)
        holes = holes_of(vertices, self.holes)
        for name, value in (('vertices', vertices), ('poses', np.asarray(self.poses, dtype=float)),
                            ('reflection', reflection), ('holes', holes),
                            ('inner_walls', partitions_of(vertices, holes, self.inner_walls))):
            object.__setattr__(self, name, value)
        self._check()

    def __repr__(self) -> str:
        return (f'Scene({self.name!r}: {len(self.vertices)} edges, {len(self.poses)} pings of {self.n_samples} samples '
                f'at {self.sample_rate_hz:g} Hz, seed {self.seed})')

    def _check(self) -> None:
        if self.poses.ndim != 2 or self.poses.shape[1] != 3 or len(self.poses) == 0:
            raise SceneError('poses must be at least one triple [x, y, yaw]')
        for positions in self.ends:
            clearances = clearance(self.vertices, positions)
            if not clearances.min() > 0.0:
                index = int(np.argmin(clearances)) if np.isfinite(clearances).all() else 0
                raise SceneError(f'the sensor is not inside the polygon at pose {index}')
            check_apart(positions, self.holes, self.inner_walls)
        for name in _BOUNDS:
            if name != 'snr_db' or self.snr_db is not None:
                check_bounds(name, getattr(self, name))
        if self.height != Height() and self.medium.model != 'constant':
            raise SceneError('height is that of a room; a plate has none: set medium.model to constant')
        for name, allowed in (('edge_fading', EDGE_FADINGS), ('echo_kind', ECHO_KINDS)):
            if getattr(self, name) not in allowed:
                raise SceneError(f'{name} must be {" or ".join(allowed)}, found {getattr(self, name)!r}')
        for name in self._on_ways:
            if self.edge_fading != 'none':
                raise SceneError(f'edge_fading does not go with {name}; leave out one of them')
            if self.has_inside:
                raise SceneError(f'{name} acts in scenes without holes and inner_walls only; leave out one of them')
        self.edges.check_outline(self.vertices, bool(self.propagation.anisotropy))
        self._check_sequences()
        self._check_size()

    @property
    def _on_ways(self) -> list[str]:
        """What needs each path's way, of those things that the scene has."""
        have = {'edges': self.edges != Edges(), 'height': self.height != Height(),
                'propagation.anisotropy': self.propagation.anisotropy, 'faults.directivity': self.faults.directivity}
        return [name for name, there in have.items() if there]

    def _check_sequences(self) -> None:
        """Whether walls inside make too many sequences."""
        if not self.has_inside:
            return
        if self.edge_fading != 'none' and len(self.circles):
            raise SceneError('edge_fading does not go with round holes; leave out one of them')
        walls = len(self.reflectors.starts) + len(self.circles)
        sequences = float(len(self.poses)) * walls * (walls - 1.0) ** (self.order - 1)
        if sequences > MOST_SEQUENCES:
            raise SceneError(f'order {self.order} makes {sequences:.3g} sequences of {walls} walls, all of which are '
                             f'tried with holes or inner_walls; allowed: {MOST_SEQUENCES:g}; take a lower order')

    def _check_size(self) -> None:
        """What several values make together."""
        pings = len(self.poses)
        if max(np.abs(self.vertices).max(), np.abs(self.poses).max()) > FARTHEST_M:
            raise SceneError(f'vertices and poses must be within {FARTHEST_M:g} m')
        if pings > MOST_PINGS or pings * self.n_samples > MOST_SAMPLES:
            raise SceneError(f'{pings} pings of {self.n_samples} samples; allowed: {MOST_PINGS} pings, and '
                             f'{MOST_SAMPLES} samples in all')
        if (messages := pings * max(self.ping_period_s * self.odometry_rate_hz, 1.0)) > MOST_ODOMETRY:
            raise SceneError(f'odometry_rate_hz makes {messages:.3g} messages; allowed: {MOST_ODOMETRY}')
        first_s = 1.0 + self.ping_period_s + self.t0_s
        if first_s < 0.0:
            raise SceneError(f't0_s would stamp the first ping {first_s:g} s, and no stamp is before 0')
        if (last_s := first_s + pings * self.ping_period_s + self.n_samples * self.period_s) > LAST_S:
            raise SceneError(f'the last ping would end at {last_s:g} s; no stamp of ROS is beyond {LAST_S:g} s')

    @property
    def has_inside(self) -> bool:
        """Whether there are holes or inner walls."""
        return bool(self.holes or self.inner_walls)

    @property
    def reflectors(self) -> Reflectors:
        """All straight walls: the outline's, the holes', the inner ones."""
        walls = Reflectors.outline(self.vertices, self.reflection)
        for hole in self.holes:
            if isinstance(hole, Hole):
                walls = walls.beside(Reflectors.outline(hole.vertices, hole.reflection))
        for wall in self.inner_walls:
            walls = walls.with_seam(wall.start, wall.end, wall.reflection, wall.transmission)
        return walls

    @property
    def circles(self) -> NDArray[np.float64]:
        """Centre, radius [m] and reflection of the round holes, shape (c, 4)."""
        return np.reshape([(*hole.centre, hole.radius_m, hole.reflection)
                           for hole in self.holes if isinstance(hole, RoundHole)], (-1, 4))

    @property
    def positions(self) -> NDArray[np.float64]:
        """True sensor positions at the pings, shape (T, 2) [m]."""
        return sensor_positions(self.poses, self.sensor)

    @property
    def ends(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """True positions of emitter and receiver at the pings, shape (T, 2) each [m]."""
        x, y = 0.5 * self.sensor.baseline_x_m, 0.5 * self.sensor.baseline_y_m
        emitter, receiver = (dataclasses.replace(self.sensor, x_m=self.sensor.x_m + side * x,
                                                 y_m=self.sensor.y_m + side * y) for side in (-1.0, 1.0))
        return sensor_positions(self.poses, emitter), sensor_positions(self.poses, receiver)

    @property
    def period_s(self) -> float:
        """Sample period [s]."""
        return 1.0 / self.sample_rate_hz

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Time of each ping's first sample [ns]; the first emission is one second and one ping period after zero."""
        emissions = 1_000_000_000 + (1 + np.arange(len(self.poses))) * round(self.ping_period_s * 1e9)
        return np.asarray(emissions + round(self.t0_s * 1e9), dtype=np.int64)

    def gains(self) -> NDArray[np.float64]:
        """Gain of the echoes of each ping, shape (T,)."""
        draws = self.generator(_GAIN_STREAM).uniform(-0.5, 0.5, len(self.poses))
        return np.asarray(10.0 ** (self.gain_range_db * draws / 20.0))

    def reported_poses(self) -> NDArray[np.float64]:
        """Poses that the odometry reports at the pings, shape (T, 3): with its drift and `position_noise_m`."""
        generator = np.random.default_rng([self.seed, _POSITION_STREAM, len(self.vertices)])
        errors = generator.normal(size=(len(self.poses), 2))
        poses = self._driven()
        poses[:, :2] += self.position_noise_m * errors
        return poses

    def _driven(self) -> NDArray[np.float64]:
        """Poses (T, 3) as erring odometry adds them up."""
        faults, drift = self.faults, LEVELS.get(self.faults.drift, Drift())
        drift = drift.beside(faults.odometry_scale, faults.yaw_drift_deg_m)
        generator = np.random.default_rng([self.seed, _DRIFT_STREAM, len(self.vertices)])
        poses = self.poses.copy() if drift == Drift() else reported(self.poses, drift, generator)
        return with_slips(poses, faults.slip_m, float(np.deg2rad(faults.slip_deg)), generator)

    def noise(self) -> NDArray[np.float64]:
        """Gaussian noise of power 1, shape (T, n_samples): white, or such that a sample's passes on to the next."""
        white = self.generator(_NOISE_STREAM).normal(size=(len(self.poses), self.n_samples))
        return white if self.faults.noise_colour == 0.0 else coloured(white, self.faults.noise_colour)

    def generator(self, stream: int) -> np.random.Generator:
        """A generator of its own for each thing that is drawn, so that options do not disturb one another."""
        return np.random.default_rng([self.seed, stream])

    def parameters(self, base: Parameters | None = None) -> Parameters:
        """The mapper's parameters for this scene: `base` with what the scene says of the device, and its grid."""
        base = base or Parameters()
        kind = base.echo.kind if self.echo_kind == 'rf' else self.echo_kind
        echo: EchoParameters = dataclasses.replace(base.echo, t0_s=self.t0_s, kind=kind)
        return dataclasses.replace(
            base, medium=self.told_medium or self.medium, pulse=self.pulse, echo=echo, sensor=self.sensor,
            grid=self.grid)


def check_bounds(name: str, value: float) -> None:
    """Raise `SceneError` for a number of a scene that is beyond its bounds."""
    low, high = _BOUNDS[name]
    if not low <= value <= high:
        raise SceneError(f'{name} must be from {low:g} to {high:g}, found {value!r}')


def sensor_positions(poses: NDArray[np.float64], sensor: SensorParameters) -> NDArray[np.float64]:
    """Positions (T, 2) of a sensor that sits at (x_m, y_m) in the base frame of poses (T, 3) [m]."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return np.column_stack((poses[:, 0] + c * sensor.x_m - s * sensor.y_m,
                            poses[:, 1] + s * sensor.x_m + c * sensor.y_m))
