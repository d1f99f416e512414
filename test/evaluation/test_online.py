"""Estimates after every ping."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.online_experiment import OnlineExperiment, OnlineRun, estimates, run_online
from polymap_ros.evaluation.online_report import online_figure, online_table, unsteady
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scene_file import load_scene


def run(right, flagged=None, method='evidence', seed=1, edges=4, seconds=None):
    right = tuple(digit == '1' for digit in right)
    flagged = tuple(digit == '1' for digit in flagged) if flagged else (False,) * len(right)
    return OnlineRun('scene', seed, edges, method, 0.0, right, flagged, seconds or (0.25,) * len(right))


def short_scene(pings):
    scene = load_scene('rectangle')
    return dataclasses.replace(scene, poses=scene.poses[:pings])


def test_a_run_counts_pings_flips_and_what_was_not_said():
    steady = run('000111', '110000')
    assert (steady.pings_until_right, steady.flips, steady.silently_wrong) == (4, 0, 1)
    nervous = run('010110', '100001')
    assert (nervous.pings_until_right, nervous.flips, nervous.silently_wrong) == (2, 2, 1)
    never = run('0000')
    assert (never.pings_until_right, never.flips, never.silently_wrong) == (None, 0, 4)
    assert never.row()['pings_until_right'] is None
    assert nervous.row()['right'] == '010110'
    assert nervous.row()['flagged'] == '100001'


def test_warm_solves_come_after_the_first_right_one():
    seconds = (1.0, 2.0, 3.0, 0.25, 0.5)
    assert run('00111', seconds=seconds).warm_seconds == (0.25, 0.5)
    assert run('00000', seconds=seconds).warm_seconds == seconds
    assert run('00001', seconds=seconds).warm_seconds == seconds


@pytest.mark.parametrize('method', ['evidence', 'paper'])
def test_the_estimates_are_those_of_a_mapper_that_heard_as_many_pings(method):
    parameters = Parameters().replaced({'solver.method': method})
    answers = list(estimates(short_scene(6), parameters))
    assert len(answers) == 6
    assert all(seconds > 0.0 for _, seconds in answers)
    assert [estimate.status for estimate, _ in answers[:2]] == ['open', 'open']
    if method == 'paper':  # from scratch: the same as without the estimates before
        fresh = filled_mapper(short_scene(6), parameters).solve()
        np.testing.assert_array_equal(answers[-1][0].polygon.vertices, fresh.polygon.vertices)


def test_a_plate_is_found_and_stays_found():
    found = run_online(short_scene(30), Parameters(), 0.003)
    assert len(found.right) == 30
    assert found.right[-1]
    assert found.pings_until_right < 30
    assert found.right[:2] == (False, False)


def test_an_experiment_runs_every_method_on_every_scene():
    experiment = OnlineExperiment('pings_20', range(4, 7, 2), range(3, 5), ['rectangle'], None, Parameters())
    assert experiment.scenes() == [(4, 3), (4, 4), (6, 3), (6, 4)]
    found, = experiment.run_one(4, 3)
    assert (found.seed, found.edges, found.method, found.snr_db, len(found.right)) == (4, 3, 'rectangle', None, 20)


def test_the_table_and_the_list_say_how_soon_and_how_steadily():
    runs = [run('0011', seconds=(1.0, 1.0, 1.0, 0.1)), run('0101', seed=2), run('0000', '1111', 'paper')]
    rows = [[cell.strip() for cell in line.strip('|').split('|')] for line in online_table(runs).splitlines()[2:]]
    assert rows[0] == ['evidence', '4', '2', '100.0 %', '3', '3', '0.50', '50.0 %', '50.0 %', '0.250', '1.000',
                       '0.250', '0.250']
    assert rows[1][:8] == ['paper', '4', '1', '0.0 %', 'never', 'never', '0.00', '100.0 %']
    assert unsteady([*runs, run('0100', seed=6)]) == (
        '- evidence, 4 edges: 2 (1 flips), 6 (1 flips, not right at the end)\n'
        '- paper, 4 edges: 1 (0 flips, not right at the end)')
    assert unsteady(runs[:1]) == '- none'


def test_the_picture_shows_shares_and_times_over_the_pings(tmp_path):
    figure = online_figure([run('0011'), run('0111', seed=2), run('0000', method='paper')], 'plates')
    success, times = figure.axes
    np.testing.assert_allclose(success.lines[0].get_ydata(), [0.0, 50.0, 100.0, 100.0])
    np.testing.assert_allclose(success.lines[1].get_ydata(), 0.0)
    np.testing.assert_array_equal(times.lines[0].get_xdata(), [1, 2, 3, 4])
    figure.savefig(tmp_path / 'online.png')
    assert (tmp_path / 'online.png').stat().st_size > 10_000
