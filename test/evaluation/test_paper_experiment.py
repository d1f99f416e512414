import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.paper_experiment import RECTANGLE, SIMULATED, PaperExperiment, by_scene
from polymap_ros.evaluation.trials import run_trials
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scene_file import load_scene


@pytest.fixture(scope='module')
def histories():
    experiment = PaperExperiment(2, 0.0, Parameters().replaced({'solver.iterations': 120}))
    return [experiment.run_one(*job) for job in experiment.jobs() if job[0] in ('triangle', 'rectangle')]


def test_every_scene_is_repeated_with_its_own_solver_seeds():
    assert PaperExperiment(2, 0.0, Parameters()).jobs() == [
        ('triangle', 1), ('triangle', 2), ('quadrilateral', 1), ('quadrilateral', 2),
        ('pentagon', 1), ('pentagon', 2), ('rectangle', 1), ('rectangle', 2)]
    assert (*SIMULATED, RECTANGLE) == ('triangle', 'quadrilateral', 'pentagon', 'rectangle')


def test_a_history_has_a_value_per_iteration_and_ends_at_the_answer(histories):
    for history in histories:
        assert history.cost.shape == history.edges.shape == history.iou.shape == (120,)
        assert np.all(history.cost < 0.0)
        assert history.cost[-20:].mean() < history.cost[:20].mean() - 2.0
        assert history.edges[-1] == history.trial.estimated_edges
        assert history.iou[-1] == pytest.approx(history.trial.iou)
        assert history.iou[0] < 0.9
    assert not np.array_equal(histories[0].cost, histories[1].cost)


def test_a_repetition_is_the_method_that_the_tools_run(histories):
    parameters = Parameters().replaced({'solver.iterations': 120, 'solver.seed': 2, 'solver.method': 'paper'})
    expected = run_trials(load_scene('triangle'), ['paper'], parameters)[0]
    assert dataclasses.replace(histories[1].trial, run=0, seconds=expected.seconds) == expected


def test_histories_are_sorted_by_scene_and_run(histories):
    runs = by_scene(histories[::-1])
    assert list(runs) == ['triangle', 'quadrilateral', 'pentagon', 'rectangle']
    assert [history.trial.run for history in runs['rectangle']] == [1, 2]
    assert runs['pentagon'] == []


def test_the_baseline_maps_the_rectangle():
    trial = PaperExperiment(1, 0.0, Parameters()).run_once(RECTANGLE, 'rectangle')
    assert (trial.method, trial.scene, trial.right) == ('rectangle', 'rectangle', True)
