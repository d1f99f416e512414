"""A result folder is complete, or untouched."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from polymap_ros.results.folder import result_folder


def test_files_appear_together_and_old_results_go(tmp_path):
    folder = tmp_path / 'a' / 'out'
    with result_folder(folder) as stage:
        (stage / 'polygon.json').write_text('1')
        (stage / 'map.pgm').write_text('1')
        assert not folder.exists()
    (folder / 'notes.txt').write_text('mine')
    with result_folder(folder) as stage:
        (stage / 'polygon.json').write_text('2')
        assert (folder / 'polygon.json').read_text() == '1'
    assert {path.name: path.read_text() for path in folder.iterdir()} == {'polygon.json': '2', 'notes.txt': 'mine'}
    assert [path.name for path in folder.parent.iterdir()] == ['out']


def test_a_failure_leaves_the_folder_as_it_was(tmp_path):
    def fail(folder):
        with result_folder(folder) as stage:
            (stage / 'polygon.json').write_text('new')
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail(tmp_path / 'out')
    assert list(tmp_path.iterdir()) == []
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out' / 'polygon.json').write_text('old')
    with pytest.raises(KeyboardInterrupt):
        fail(tmp_path / 'out')
    assert (tmp_path / 'out' / 'polygon.json').read_text() == 'old'
    assert [path.name for path in tmp_path.iterdir()] == ['out']


WRITER = """
import itertools, sys
from pathlib import Path
from polymap_ros.results.folder import result_folder
for run in itertools.count():
    with result_folder(Path(sys.argv[1])) as stage:
        for name in ('state.npz', 'map.pgm', 'map.yaml', *(['polygon.csv'] if run % 3 else []), 'polygon.json'):
            (stage / name).write_text(str(run))
    print(run, flush=True)
"""


def test_whatever_moment_the_process_is_killed_no_files_of_two_runs_are_mixed(tmp_path):
    generator, folder = np.random.default_rng(1), tmp_path / 'out'
    for _ in range(12):
        process = subprocess.Popen([sys.executable, '-c', WRITER, folder], stdout=subprocess.PIPE)
        process.stdout.readline()
        time.sleep(generator.uniform(0.0, 0.03))  # the moment of the kill
        process.send_signal(signal.SIGKILL)
        process.communicate()
        runs = {path.read_text() for path in folder.iterdir()}
        assert len(runs) == 1
        if (folder / 'polygon.json').exists():
            assert {path.name for path in folder.iterdir()} >= {'state.npz', 'map.pgm', 'map.yaml'}


def test_a_folder_in_the_place_of_a_result_is_an_error_before_anything_is_removed(tmp_path):
    for name in ('state.npz', 'polygon.json'):
        (tmp_path / name).write_text('old')
    (tmp_path / 'map.yaml').mkdir()
    with pytest.raises(IsADirectoryError, match=r'map\.yaml'), result_folder(tmp_path) as stage:
        (stage / 'polygon.json').write_text('new')
    assert (tmp_path / 'state.npz').read_text() == (tmp_path / 'polygon.json').read_text() == 'old'


def test_a_file_in_the_way_is_an_error(tmp_path):
    (tmp_path / 'out').write_text('a file')
    with pytest.raises(FileExistsError), result_folder(tmp_path / 'out') as stage:
        (stage / 'polygon.json').write_text('new')
    assert [path.name for path in tmp_path.iterdir()] == ['out']
