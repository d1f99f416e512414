import os
import signal

import pytest

from polymap_ros.errors import SceneError
from polymap_ros.evaluation.parallel import run_jobs
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.scene_file import load_scene


def where(index):
    return index, os.getpid()


def test_one_process_is_this_one():
    assert list(run_jobs(where, [(3,), (1,)], 1)) == [(3, os.getpid()), (1, os.getpid())]


def test_processes_share_the_jobs_and_give_the_results_of_one():
    names = {scene.name for scene in run_jobs(random_scene, [(1, 3), (2, 3), (3, 3)], 2)}
    assert names == {'convex-3-1', 'convex-3-2', 'convex-3-3'}


def test_an_error_in_another_process_arrives_in_this_one():
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(SceneError, match='nowhere'):
        list(run_jobs(load_scene, [('nowhere',), ('triangle',)], 2))
    assert signal.getsignal(signal.SIGINT) is before
