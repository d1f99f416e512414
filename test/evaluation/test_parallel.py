import os
import select
import signal
import subprocess
import sys
import threading
from pathlib import Path

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


def held(fifo):
    """Holds a FIFO open as long as this process lives."""
    held_open = open(fifo, 'w')  # noqa: PTH123, SIM115
    print('here', file=held_open, flush=True)
    threading.Event().wait()


def test_processes_end_with_the_one_that_started_them_even_where_it_is_killed(tmp_path):
    fifos = [tmp_path / 'one', tmp_path / 'two']
    for fifo in fifos:
        os.mkfifo(fifo)
    code = 'import sys, test_parallel as t; list(t.run_jobs(t.held, [(fifo,) for fifo in sys.argv[1:]], 2))'
    parent = subprocess.Popen([sys.executable, '-c', code, *map(str, fifos)],
                              env={**os.environ, 'PYTHONPATH': str(Path(__file__).parent)})
    streams = [fifo.open() for fifo in fifos]
    assert [stream.readline() for stream in streams] == ['here\n', 'here\n']
    parent.kill()
    parent.wait()
    for stream in streams:
        assert select.select([stream], [], [], 30.0)[0]
        assert stream.read() == ''  # its only writer is gone
        stream.close()
