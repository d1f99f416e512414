"""Trials on a real simulated scene, and how an answer is judged."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.cautions import Caution
from polymap_ros.evaluation.random_experiment import RandomExperiment, in_order
from polymap_ros.evaluation.trials import filled_mapper, judged, run_trials
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate

EDGE = Edge(1.0, 0.0, 1.0)


def answer(vertices):
    return Estimate('closed', 'paper', polygon=Candidate(np.asarray(vertices), (EDGE,) * len(vertices)))


def test_an_answer_is_judged_by_its_walls():
    scene = load_scene('rectangle')
    trial = judged(answer([[0, 0], [1.0, 0], [1.0, 0.752], [0, 0.752]]), scene, 'paper', 0.1, run=3)
    assert (trial.scene, trial.edges, trial.estimated_edges, trial.run, trial.seconds) == ('rectangle', 4, 4, 3, 0.1)
    assert trial.right
    assert sorted(trial.offsets_m) == pytest.approx([0.0, 0.0, 0.0, 0.002], abs=1e-12)
    assert trial.angles_deg == pytest.approx([0.0] * 4, abs=1e-9)
    assert trial.iou == pytest.approx(0.75 / 0.752)
    wide = judged(answer([[0, 0], [1.0, 0], [1.0, 0.756], [0, 0.756]]), scene, 'paper', 0.1)
    assert not wide.right
    assert judged(answer([[0, 0], [1.0, 0], [1.0, 0.756], [0, 0.756]]), scene, 'paper', 0.1, tolerance_m=0.01).right


def test_a_device_gives_the_magnitudes_that_a_mapper_takes():
    """A signal with its sign left out has ripples, by which walls explain half of it."""
    scene = VARIANTS['air'].make(4, 4)
    answer = filled_mapper(scene, Parameters().replaced({'echo.kind': 'envelope'})).solve()
    assert (answer.status, answer.cautions) == ('closed', ())
    assert judged(answer, scene, 'evidence', 0.0).right


def test_errors_are_judged_by_the_standard_deviations_and_real_edges_counted():
    scene = load_scene('rectangle')
    edges = (Edge(0.001, -np.pi / 2, 0.95, 0.002, 0.1), Edge(1.03, 0.01, 0.92, 0.01, 0.004),
             Edge(0.75, np.pi / 2, 0.5, 0.002, 0.1), Edge(0.0, np.pi, 1.0, 0.002, 0.1))
    corners, which = half_plane_polygon(np.array([(edge.r, edge.theta) for edge in edges]))
    edges = tuple(edges[index] for index in which)
    cautions = Caution('weak_edge', ''), Caution('unexplained', '')
    estimate = Estimate('closed', 'evidence', polygon=Candidate(corners, edges), cautions=cautions)
    trial = judged(estimate, scene, 'evidence', 0.1)
    assert sorted(trial.z_r) == pytest.approx([0.0, 0.0, 0.5, 3.0])
    assert sorted(trial.z_theta) == pytest.approx([0.0, 0.0, 0.0, 2.5])
    assert (trial.certain_edges, trial.certain_real, trial.least_likelihood) == (3, 2, 0.5)
    assert (trial.cautions, trial.flagged) == (('weak_edge', 'unexplained'), True)
    plain = judged(answer([[0, 0], [1.0, 0], [1.0, 0.75], [0, 0.75]]), scene, 'paper', 0.1)
    assert (plain.z_r, plain.flagged, plain.certain_real) == ((), False, 4)


def test_lengths_angles_and_area_are_judged_edge_by_edge():
    """A rectangle 2 mm too long, whose corners are listed from another one than the truth's."""
    edges = tuple(Edge(r, theta, 1.0, 0.001, 0.001) for r, theta in (
        (1.002, 0.0), (0.75, np.pi / 2), (0.0, np.pi), (0.0, -np.pi / 2)))
    corners = [[1.002, 0], [1.002, 0.75], [0, 0.75], [0, 0]]
    trial = judged(Estimate('closed', 'evidence', polygon=Candidate(np.array(corners), edges)),
                   load_scene('rectangle'), 'evidence', 0.1)
    # Each end of the upper edge moves with r of the short edge there, and by 0.75 m times its angle.
    spread = np.sqrt(2 * 0.001**2 + 2 * (0.75 * 0.001) ** 2)
    assert trial.right
    assert trial.z_length == pytest.approx([0.0, 0.002 / spread, 0.0, 0.002 / np.sqrt(2e-6)], abs=1e-9)
    assert trial.z_angle == pytest.approx([0.0] * 4, abs=1e-9)
    assert 0.5 < trial.z_area[0] < 2.0
    assert judged(answer([[0, 0], [1.0, 0], [1.0, 0.75], [0, 0.75]]), load_scene('rectangle'), 'paper', 0.1
                  ).z_length == ()


def test_deviations_of_random_plates_hold_their_promise():
    """Twelve plates at 0 dB: about 95 % of the true sizes lie within two deviations; the deviations are no excuse."""
    trials = [trial for seed in (3001, 3002, 3003, 3004) for edges in (4, 6, 8)
              for trial in run_trials(random_scene(seed, edges), ['evidence'], Parameters())]
    assert all(trial.right for trial in trials)
    for name, number in (('z_length', 72), ('z_angle', 72), ('z_area', 12)):
        scores = np.array([score for trial in trials for score in getattr(trial, name)])
        assert len(scores) == number
        assert np.mean(np.abs(scores) <= 2.0) >= 0.9
        assert 0.3 < np.sqrt(np.mean(scores**2)) < 1.3


def test_a_missing_wall_has_no_error():
    trial = judged(answer([[0, 0], [1.0, 0], [0, 0.75]]), load_scene('rectangle'), 'paper', 0.1)
    assert (trial.estimated_edges, trial.right, len(trial.offsets_m), len(trial.angles_deg)) == (3, False, 3, 3)


def test_no_polygon_is_wrong_and_has_no_errors():
    trial = judged(Estimate('open', 'paper'), load_scene('rectangle'), 'paper', 0.1)
    assert (trial.status, trial.right, trial.iou, trial.estimated_edges) == ('open', False, 0.0, 0)
    assert trial.offsets_m == trial.z_r == ()
    assert trial.flagged
    assert trial.row()['max_offset_m'] is None


def test_several_methods_map_the_same_scene():
    trials = run_trials(load_scene('rectangle'), ['paper', 'rectangle'], Parameters())
    assert [(trial.method, trial.right) for trial in trials] == [('paper', True), ('rectangle', True)]
    assert all(0.0 < trial.seconds < 60.0 for trial in trials)


def test_ranges_come_from_the_signals():
    """They are right where the echoes are clear and wrong where noise swamps them, though the scene knows the walls."""
    scene = load_scene('rectangle')
    x, y = scene.positions.T
    true = np.min([x, 1.0 - x, y, 0.75 - y], axis=0)
    for snr_db, least, most in ((None, 0.95, 1.0), (-60.0, 0.0, 0.15)):
        mapper = filled_mapper(dataclasses.replace(scene, snr_db=snr_db), Parameters())
        near = [abs(sounding.rho - range_m) < 0.01 for sounding, range_m in zip(mapper.soundings, true, strict=True)]
        assert least <= np.mean(near) <= most


def test_the_mapper_is_given_the_reported_positions():
    scene = dataclasses.replace(load_scene('rectangle'), position_noise_m=0.02)
    mapper = filled_mapper(scene, Parameters())
    start = np.array([mapper.start_pose.x, mapper.start_pose.y])
    np.testing.assert_allclose(start, scene.reported_poses()[0, :2], atol=1e-12)


def test_a_random_experiment_runs_every_method_on_every_scene():
    experiment = RandomExperiment('pings_20', range(5, 7), range(3, 5), ['rectangle', 'paper'], [-10.0, None],
                                  Parameters())
    assert experiment.scenes() == [
        (seed, edges, snr_db) for seed in (5, 6) for edges in (3, 4) for snr_db in (-10.0, None)]
    trials = in_order([trial for scene in experiment.scenes()[::-1] for trial in experiment.run_one(*scene)])
    assert [(trial.seed, trial.edges, trial.snr_db, trial.method) for trial in trials] == [
        (seed, edges, snr_db, method) for seed in (5, 6) for edges in (3, 4) for snr_db in (None, -10.0)
        for method in ('paper', 'rectangle')]


@pytest.mark.parametrize('name', VARIANTS)
def test_variants_differ_from_the_plain_scene_as_their_name_says(name):
    edges = 3 if name == 'needle' else 5
    scene, plain = VARIANTS[name].make(11, edges), random_scene(11, edges)
    assert len(scene.vertices) == edges
    changed = {
        'plate': False, 'pings_20': len(scene.poses) == 20, 'pings_40': len(scene.poses) == 40,
        'lossy': scene.reflection.min() < 0.99, 'gain': scene.gain_range_db == 6.0,
        'position_noise': scene.position_noise_m == 0.005, 'air': scene.pulse.frequency_hz == 20e3,
        'air_chirp': scene.pulse.kind == 'chirp', 'apart': scene.sensor.baseline_m == 0.05,
        'yaw_drift': scene.faults.yaw_drift_deg_m == 2.0, 'odometry_scale': scene.faults.odometry_scale == 1.02,
        'room': scene.height.floor_m > 0.0 and scene.reflection.max() < 0.9,
        'missing_first': scene.faults.missing_first == 0.2, 'false_first': scene.faults.false_first == 0.2,
        'clutter': scene.faults.direct_wave == scene.faults.clutter == 10.0,
        's0_-20db': scene.faults.second_mode == 0.1, 's0_-10db': scene.faults.second_mode == 10.0**-0.5,
        's0_0db': scene.faults.second_mode == 1.0,
        'free_edge': scene.edges.kind == 'free', 'phase_45': scene.edges.delay_deg == 45.0,
        'phase_90': scene.edges.delay_deg == 90.0, 'phase_180': scene.edges.delay_deg == 180.0,
        'phase_by_wall': scene.edges.spread_deg == 45.0,
        'q_3': scene.faults.transducer_q == 3.0 and 0.92 <= scene.faults.transducer_centre <= 1.08,
        'q_5': scene.faults.transducer_q == 5.0, 'q_10': scene.faults.transducer_q == 10.0,
        'q_5_twice': scene.faults.transducer_times == 2,
        'q_5_free_edge': scene.edges.kind == 'free' and scene.faults.transducer_q == 5.0,
        'edge_fading': scene.edge_fading == 'fresnel', 'order_4': scene.order == 4,
        'order_8': scene.order == 8 and 0.8 <= np.abs(scene.reflection).min() < 0.95,
        'damped_0.3': sorted(scene.reflection) == [0.3, 1.0, 1.0, 1.0, 1.0],
        'damped_0.2': sorted(scene.reflection) == [0.2, 1.0, 1.0, 1.0, 1.0],
        'curved_100': abs(scene.edges.curvature_1_m) == 0.01, 'curved_20': abs(scene.edges.curvature_1_m) == 0.05,
        'rounded': scene.edges.corner_radius_m == 0.02,
        **{f'{kind}_file': scene.pulse.kind == 'file' for kind in ('q_5', 'q_10', 'q_5_twice', 'q_5_free_edge')},
        'line': scene.faults.lines == 1, 'line_+4db': scene.faults.line_db == 4.0,
        'line_+10db': scene.faults.line_db == 10.0, 'lines': scene.faults.lines == 3,
        'impulses': scene.faults.impulses == 0.02, 'impulses_rung': scene.faults.impulse_width == 0.7,
        'delay': scene.edges.delay_s == 2.5e-6, 'attenuated': scene.propagation.attenuation_np_m == 0.35,
        'directed': scene.faults.directivity == 0.3, 'coloured': scene.faults.noise_colour == 0.9,
        'mild': scene.edges.kind == 'free' and scene.faults.transducer_q == 3.0 and scene.order == 8,
        'speed_drift_0.5': scene.propagation.speed_drift == 0.005,
        'speed_drift_1': scene.propagation.speed_drift == 0.01, 'anisotropy_1': scene.propagation.anisotropy == 0.01,
        'anisotropy_2': scene.propagation.anisotropy == 0.02 and scene.propagation.anisotropy_deg > 0.0,
        'thinner': scene.parameters().medium.thickness_m == 0.8 * scene.medium.thickness_m,
        'thicker': scene.parameters().medium.thickness_m == 1.2 * scene.medium.thickness_m,
        'steel_as_aluminium': scene.medium.shear_speed_m_s > scene.parameters().medium.shear_speed_m_s,
        'aluminium_as_steel': scene.medium.shear_speed_m_s < scene.parameters().medium.shear_speed_m_s,
    }.get(name, not np.allclose(scene.vertices, plain.vertices))
    assert changed == (name != 'plate')
    assert VARIANTS[name].tolerance_m == (0.01 if name in ('air', 'air_chirp', 'room') else 0.003)


def test_clutter_hides_the_room_until_it_is_taken_out():
    scene = VARIANTS['clutter'].make(4, 4)
    [hidden] = run_trials(scene, ['evidence'], Parameters())
    [found] = run_trials(scene, ['evidence'], Parameters().replaced({'front_end.common_pings': 32}))
    assert (hidden.right, hidden.flagged) == (False, True)
    assert (found.right, found.flagged) == (True, False)
