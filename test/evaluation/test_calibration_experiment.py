"""The calibration experiment: its scenes have the faults they are named for, and its table says what came out."""

import numpy as np

from polymap_ros.evaluation.calibration_experiment import (
    CASES,
    CalibrationExperiment,
    CalibrationTrial,
    calibration_table,
)
from polymap_ros.parameters import Parameters


def test_both_signs_and_both_materials_come_up_for_odd_seeds_alone():
    seeds = range(1, 5, 2)
    drifts = {CASES['yaw_drift'].make(seed, 4).faults.yaw_drift_deg_m for seed in seeds}
    scales = {CASES['odometry_scale'].make(seed, 4).faults.odometry_scale for seed in seeds}
    told = {CASES['material'].make(seed, 4).told_medium.shear_speed_m_s for seed in seeds}
    thickness = {round(CASES['thickness'].make(seed, 4).told_medium.thickness_m, 6) for seed in seeds}
    assert (scales, told, thickness) == ({0.98, 1.02}, {3235.0, 3097.0}, {0.0048, 0.0072})
    assert drifts == {-2.0, 2.0}


def test_a_straight_path_is_refused_and_the_row_says_so():
    experiment = CalibrationExperiment(['straight'], [1], [4], 0.0, Parameters())
    assert experiment.scenes() == [('straight', 1, 4)]
    trial, = experiment.run_one('straight', 1, 4)
    assert 'drive a turn' in trial.refused
    assert trial.row()['scores'] == ''
    assert trial.flagged


def test_the_table_counts_and_takes_magnitudes():
    common = {'case': 'yaw_drift', 'edges': 4, 'clean_right': True, 'flagged': True, 'refused': '', 'seconds': 2.0}
    trials = [
        CalibrationTrial(seed=seed, named=named, scale_error_percent=-0.01 * seed, drift_error_deg_m=0.1,
                         scores=(0.5, 3.0), right=seed == 1, **common)
        for seed, named in ((1, 'odometry'), (3, 'medium'), (5, ''))]
    row = [cell.strip() for cell in calibration_table(trials).splitlines()[2].strip('|').split('|')]
    assert row[:6] == ['yaw drift of 2 deg/m', '3', '100.0 %', '33.3 %', '33.3 %', '0.0 %']
    assert float(row[6].split(' / ')[0]) == np.median([0.01, 0.03, 0.05])
    assert row[8:] == ['50.0 %', '33.3 %', '100.0 %', '2.0']
