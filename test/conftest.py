"""What all tests share: the ROS environment (a domain of their own), heard scenes, and references of their own."""

import importlib.util
import os
import signal
import tempfile
from pathlib import Path

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # two processes of tests on two cores; before numpy is imported

import numpy as np
import pytest
from heard_scenes import PENTAGON, TRIANGLE, feed, hear, listen
from references import inside

from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import simulate

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
    'test_that_more_edges_are_certain_than_are_allowed_is_told', 'test_a_recording_is_localised_in_a_map',
    'test_paths_of_real_wheels', 'test_the_medium_is_found_and_its_file_used_next_time',
    'test_a_scene_is_mapped_and_told_in_a_row', 'test_a_ping_that_belongs_nowhere_is_lost_and_costs_nothing_else',
    'test_the_thickness_is_found_and_named', 'test_who_is_told_which_of_both_goes_on_there',
    'test_what_is_known_of_the_odometry_is_taken_out_of_places_and_path',
    'test_every_recording_has_its_result_though_a_worker_is_killed', 'test_a_slip_is_told_with_its_time_and_size',
    'test_of_a_polygon_and_its_mirror_image_the_better_one_is_found',
    'test_a_reset_forgets_the_pose_and_not_the_map', 'test_a_wrong_time_zero_is_found_to_a_fraction_of_a_microsecond',
    'test_after_a_restart_elsewhere_the_robot_is_found_and_the_map_goes_on', 'test_scale_and_drift_are_found_and_named',
    'test_a_replay_writes_the_pulse_which_the_next_one_takes',
    'test_a_recording_may_have_more_parts_than_a_process_may_have_files_at_first',
    'test_outlines_that_are_not_convex_are_mapped', 'test_where_only_convex_ones_are_asked_for_an_l_stays_open',
    'test_an_l_with_real_corners_is_mapped', 'test_a_rectangular_hole_does_not_become_a_round_one',
    'test_the_solver_maps_by_the_pulse_that_it_finds_and_goes_on_with_it',
    'test_what_is_unexplained_may_need_more_edges_than_are_allowed',
    'test_one_ping_aside_of_a_straight_path_does_not_tell_sides', 'test_in_echoes_of_the_wave_equation_little_is_left',
    'test_the_pulse_of_a_transducer_is_found_and_the_walls_with_it'}
"""Tests of ten seconds and more, together half of the time: ``pytest -m heavy`` runs them."""

HERE = Path(__file__).parent
CRASHED: set[str] = set()
"""Tests that are tried again since their worker crashed."""


def pytest_collection_modifyitems(items):
    for item in items:
        if item.originalname in HEAVY:
            item.add_marker(pytest.mark.heavy)
        if os.path.relpath(item.path, HERE).startswith(LONG):
            item.add_marker(pytest.mark.long)


@pytest.hookimpl(optionalhook=True)
def pytest_handlecrashitem(crashitem, report, sched):
    """Where a worker that talks to a node crashes, another worker tries that test again, once.

    The middleware runs in the worker, too. Twice a worker crashed in a test of diagnostics, by what is not known: more
    than an hour of trying on a loaded machine did not show it. The node under test is a process of its own, whose end
    by a signal stays a failure. The summary counts what was tried again, and the traces of the worker's threads are on
    stderr.
    """
    if crashitem.startswith('test/node/') and crashitem not in CRASHED:
        CRASHED.add(crashitem)
        report.outcome = 'rerun'
        sched.mark_test_pending(crashitem)


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
    feed(mapper, scene, samples)
    return mapper


@pytest.fixture(scope='session')
def triangle():
    return TRIANGLE


@pytest.fixture(scope='session')
def pentagon():
    return PENTAGON


@pytest.fixture(scope='session')
def in_pentagon():
    """Forty noisy pings about the pentagon at 0 dB, order 5."""
    return hear(PENTAGON, inside(PENTAGON, 40), seed=3)


@pytest.fixture(scope='module')
def hexagon():
    """A scene of six edges, its samples, its first answer (by sixty pings) and the mapper's state before that."""
    scene = random_scene(107, 6)
    samples = simulate(scene).astype(np.float32)
    mapper = listen(scene, samples)
    state = mapper.state()
    return scene, samples, mapper.solve(), state
