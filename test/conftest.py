"""What all tests share: the ROS environment (a domain of their own), heard scenes, and references of their own."""

import dataclasses
import importlib.util
import itertools
import os
import signal
import tempfile
from pathlib import Path

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # two processes of tests on two cores; before numpy is imported

import numpy as np
import pytest
import shapely

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.listening import Listener
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import noise_free, simulate
from polymap_ros.solvers.evidence.data import EchoData

QUICK_DISCOVERY = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
  <participant profile_name="quick" is_default_profile="true"><rtps><builtin><discovery_config>
    <leaseDuration><sec>10</sec></leaseDuration>
    <leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
  </discovery_config></builtin></rtps></participant></profiles></dds>
"""


def _ros_environment(folder: Path) -> None:
    profile = folder / 'quick_discovery.xml'
    profile.write_text(QUICK_DISCOVERY)
    os.environ.update({
        'ROS_DOMAIN_ID': str(1 + os.getpid() % 100),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_PYTHON_CHECK_FIELDS': '1',
        'ROS_LOG_DIR': str(folder / 'log'),
        'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
        'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile),
    })
    os.environ.pop('ROS_LOCALHOST_ONLY', None)


# A shell without job control starts what runs in its background with SIGINT ignored, and so would every process be that
# a test interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # as nohup has it ignored

if importlib.util.find_spec('rclpy') is not None:
    _FOLDER = tempfile.TemporaryDirectory(prefix='polymap_ros_test_')
    _ros_environment(Path(_FOLDER.name))


LONG = ('node', 'calibration', 'solvers/evidence/test_doubt', 'solvers/evidence/test_drift',
        'solvers/evidence/test_localising', 'solvers/evidence/test_solver', 'evaluation', 'commands/test_calibrating',
        'commands/test_copper_tilt', 'commands/test_evaluate', 'commands/test_fleet', 'commands/test_replay')
"""Folders and files whose tests take two thirds of the time; what is tried on the oldest versions goes without them."""

HEAVY = {
    'test_nothing_is_compiled_after_the_warm_up', 'test_without_numba_everything_works_and_says_that_it_is_slow',
    'test_clutter_hides_the_room_until_it_is_taken_out', 'test_deviations_of_random_plates_hold_their_promise',
    'test_in_a_map_that_is_symmetric_the_reported_poses_decide', 'test_steel_taken_for_aluminium_takes_two_numbers',
    'test_a_wall_that_is_silent_is_missed_by_magnitudes_too',
    'test_places_that_repeat_make_no_wall_certain_that_is_not_there',
    'test_a_replay_with_the_wrong_medium_says_what_fits', 'test_the_map_peaks_at_the_copper_plane',
    'test_after_a_pause_pings_are_kept_until_it_is_known_where_the_robot_is', 'test_a_straight_path_is_flagged',
    'test_in_a_map_frame_path_and_polygon_stay_where_they_are', 'test_growth_over_what_may_grow',
    'test_kill_at_any_moment_of_a_save_leaves_whole_results_only', 'test_carried_away_it_is_found_elsewhere',
    'test_beside_a_straight_path_a_silent_wall_leaves_the_polygon_open',
    'test_that_more_edges_are_certain_than_are_allowed_is_told', 'test_a_recording_is_localised_in_a_map'}
"""Tests of a quarter of a minute and more, together a third of the time: ``pytest -m heavy`` runs them."""

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items):
    for item in items:
        if item.originalname in HEAVY:
            item.add_marker(pytest.mark.heavy)
        if os.path.relpath(item.path, HERE).startswith(LONG):
            item.add_marker(pytest.mark.long)


FAR = 1e4
"""Half the side of the square that stands for the whole plane, in units of the farthest line."""


def _clipped_plane(lines):
    """Vertices of an intersection of half-planes: a huge square clipped by one after the other."""
    polygon = FAR * np.abs(lines[:, 0]).max() * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    for r, theta in lines:
        depth = r - polygon @ (np.cos(theta), np.sin(theta))
        kept = []
        for i in range(len(polygon)):
            if depth[i - 1] * depth[i] < 0.0:
                share = depth[i - 1] / (depth[i - 1] - depth[i])
                kept.append(polygon[i - 1] + share * (polygon[i] - polygon[i - 1]))
            if depth[i] >= 0.0:
                kept.append(polygon[i])
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def _bounded_area(lines):
    """The intersection of half-planes as a shapely polygon, empty where it is unbounded."""
    angles = np.sort(np.mod(lines[:, 1], 2 * np.pi))
    if np.diff(angles, append=angles[0] + 2 * np.pi).max() > np.pi - 1e-9:
        return shapely.Polygon()
    polygon = _clipped_plane(lines)
    return shapely.Polygon(polygon) if len(polygon) > 2 else shapely.Polygon()


def _shapely_iou(first, second):
    union = first.union(second).area
    return first.intersection(second).area / union if union else 0.0


def _feed(mapper, scene, samples):
    """Give a mapper all poses and pings of a scene."""
    for stamp_ns, pose, row in zip(scene.stamps_ns.tolist(), scene.reported_poses().tolist(), samples, strict=True):
        mapper.add_pose(stamp_ns, Pose(*pose))
        mapper.add_ping(Ping(stamp_ns, row, scene.period_s, scene.t0_s))


@pytest.fixture(scope='session')
def bounded_area():
    return _bounded_area


@pytest.fixture(scope='session')
def shapely_iou():
    return _shapely_iou


@pytest.fixture(scope='session')
def feed():
    return _feed


@pytest.fixture(scope='session')
def quadrilateral():
    """A random scene with four edges, and the samples of its pings."""
    scene = random_scene(1, 4)
    return scene, simulate(scene).astype(np.float32)


@pytest.fixture(scope='session')
def heard(quadrilateral):
    """A mapper that has heard all pings of the quadrilateral; only to be read."""
    scene, samples = quadrilateral
    mapper = PolygonMapper(scene.parameters(Parameters()).replaced({'solver.method': 'paper'}))
    _feed(mapper, scene, samples)
    return mapper


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
