"""The experiment under drift: what is counted as right, lost and silently wrong, and what its table says."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.cautions import Caution
from polymap_ros.evaluation.slam_experiment import CASES, SlamExperiment, path_failures, slam_table, slam_trial
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, Trajectory


def answer(scene, motion, cautions=(), lost=()):
    """The truth as an answer, path and polygon moved alike."""
    corners = motion.apply(scene.vertices)
    edges = tuple(Edge(0.0, 0.0, 1.0, 1e-3, 1e-3) for _ in corners)
    poses = np.column_stack((motion.apply(scene.poses[:, :2]), scene.poses[:, 2] + motion.yaw))
    count = len(poses)
    path = Trajectory(tuple(scene.stamps_ns.tolist()), poses, scene.reported_poses(), np.zeros((count, 3, 3)),
                      np.where(np.isin(np.arange(count), lost), 0.0, 1.0))
    return Estimate('closed', 'evidence', polygon=Candidate(corners, edges), cautions=tuple(cautions), trajectory=path)


def test_an_answer_that_is_the_truth_moved_is_right():
    scene = random_scene(1, 4)
    trial = slam_trial('typical', scene, answer(scene, Pose(3.0, -1.0, 0.7), lost=[5, 6]), 0.0, 0.003)
    assert trial.trial.right
    assert trial.path.worst_m < 1e-12
    assert (trial.corrected, trial.lost) == (True, 2)


@pytest.mark.parametrize(('codes', 'silent'), [((), True), (('odometry_drift', 'slip'), True),
                                               (('odometry_drift', 'unexplained'), False), (('lost',), False)])
def test_what_only_tells_of_the_correction_flags_no_wrong_answer(codes, silent):
    scene = random_scene(1, 4)
    wrong = answer(scene, Pose(0.0, 0.0), [Caution(code, 'found') for code in codes])
    polygon = dataclasses.replace(wrong.polygon, vertices=1.1 * scene.vertices)
    trial = slam_trial('typical', scene, dataclasses.replace(wrong, polygon=polygon), 0.0, 0.003)
    assert not trial.trial.right
    assert trial.silently_wrong == silent
    assert ('(silently wrong)' in path_failures([trial])) == silent


def test_a_scene_is_mapped_and_told_in_a_row():
    experiment = SlamExperiment(['none', 'typical'], [2], [4], 0.0, Parameters())
    assert experiment.scenes() == [('none', 2, 4), ('typical', 2, 4)]
    trials = [trial for each in experiment.scenes() for trial in experiment.run_one(*each)]
    exact, drifting = trials
    assert (exact.corrected, exact.odometry.ate_m) == (False, 0.0)
    assert drifting.corrected
    assert drifting.odometry.ate_m > 0.01 > 10.0 * drifting.path.ate_m
    rows = slam_table(trials).splitlines()[2:]
    assert [row.split(' | ')[:2] for row in rows] == [['| exact odometry', '1 of 1'], ['| typical', '1 of 1']]
    assert path_failures(trials) == '- none'


def test_magnitudes_in_air_tell_walls_and_path_to_millimetres():
    [trial] = SlamExperiment(['air_magnitudes'], [4], [4], 0.0, Parameters()).run_one('air_magnitudes', 4, 4)
    assert trial.trial.right
    assert trial.odometry.ate_m > 0.1 > 30.0 * trial.path.ate_m


@pytest.mark.parametrize('name', CASES)
def test_every_case_makes_a_scene_whose_odometry_errs_as_it_says(name):
    scene = CASES[name].make(2, 4)
    errs = np.abs(scene.reported_poses() - scene.poses).max() > 1e-3
    assert errs == (name != 'none')
