"""A result folder: the answer first, whole or not at all, and each of what accompanies it by itself."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from polymap_ros.errors import OutputError
from polymap_ros.results.folder import Entry, check_folder, write_results


def files(**texts):
    """Entries of files by their names, whose dot is written as an underscore."""
    return [Entry.of(name.replace('_', '.'), text.encode) for name, text in texts.items()]


def content(folder):
    return {path.name: path.read_text() for path in folder.iterdir()}


def failing(name, error):
    def write(folder):
        (folder / name).write_text('half')
        raise error

    return Entry((name,), write)


def test_files_appear_and_old_results_go(tmp_path):
    folder = tmp_path / 'a' / 'out'
    assert write_results(folder, files(polygon_json='1', state_npz='1'), files(map_pgm='1')) == []
    assert content(folder) == {'polygon.json': '1', 'state.npz': '1', 'map.pgm': '1'}
    (folder / 'notes.txt').write_text('mine')
    assert write_results(folder, files(polygon_json='2'), []) == []
    assert content(folder) == {'polygon.json': '2', 'notes.txt': 'mine'}
    assert [path.name for path in folder.parent.iterdir()] == ['out']


def test_the_answer_is_there_before_anything_else_is_made(tmp_path):
    seen = []
    entry = Entry.of('map.pgm', lambda: seen.append(content(tmp_path / 'out')))
    assert write_results(tmp_path / 'out', files(polygon_json='1', state_npz='1'), [entry]) == []
    assert seen == [{'polygon.json': '1', 'state.npz': '1'}]
    assert content(tmp_path / 'out') == seen[0]  # no bytes: nothing to write


@pytest.mark.parametrize(('error', 'cause'), [
    (OSError(28, 'No space left on device'),
     'No space left on device; free some space there, or where df -i tells of no inodes, remove files'),
    (MemoryError(), 'not enough memory'), (ZeroDivisionError('by zero'), 'ZeroDivisionError: by zero'),
    (ImportError('no backend'), 'ImportError: no backend'), (RecursionError('too deep'), 'RecursionError: too deep')])
def test_what_fails_costs_itself_alone(tmp_path, error, cause):
    (failed,) = write_results(
        tmp_path, files(polygon_json='1'), [*files(map_pgm='1'), failing('polygon.png', error), *files(map_yaml='1')])
    assert content(tmp_path) == {'polygon.json': '1', 'map.pgm': '1', 'map.yaml': '1'}
    assert failed.names == ('polygon.png',)
    assert failed.cause.startswith(cause)
    assert str(tmp_path) not in failed.cause


def test_without_a_state_there_is_still_the_polygon(tmp_path):
    (failed,) = write_results(tmp_path, [*files(polygon_json='1'), failing('state.npz', MemoryError())], [])
    assert content(tmp_path) == {'polygon.json': '1'}
    assert str(failed) == 'state.npz: not written: not enough memory'
    assert failed.within(tmp_path) == f'{tmp_path}/state.npz: not written: not enough memory'


def test_a_polygon_that_cannot_be_written_leaves_the_folder_as_it_was(tmp_path):
    (tmp_path / 'polygon.json').write_text('old')
    with pytest.raises(OutputError, match=f'^{tmp_path}: cannot be written: Read-only file system'):
        write_results(tmp_path, [failing('polygon.json', OSError(30, 'Read-only file system'))], files(map_pgm='1'))
    assert content(tmp_path) == {'polygon.json': 'old'}


def test_an_interrupt_before_the_answer_leaves_nothing_and_after_it_the_answer(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        write_results(tmp_path / 'out', [failing('polygon.json', KeyboardInterrupt())], [])
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(KeyboardInterrupt):
        write_results(tmp_path / 'out', files(polygon_json='1'), [failing('map.pgm', KeyboardInterrupt())])
    assert content(tmp_path / 'out') == {'polygon.json': '1'}
    assert [path.name for path in tmp_path.iterdir()] == ['out']


WRITER = """
import itertools, sys
from pathlib import Path
from polymap_ros.results.folder import Entry, write_results
for run in itertools.count():
    names = ['polygon.json', 'state.npz', 'map.pgm', 'map.yaml', *(['polygon.csv'] if run % 3 else [])]
    entries = [Entry.of(name, str(run).encode) for name in names]
    assert write_results(Path(sys.argv[1]), entries[:2], entries[2:]) == []
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
        found = {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}
        assert len(set(found.values())) <= 1
        if 'polygon.json' in found:
            assert 'state.npz' in found
    write_results(folder, files(polygon_json='last'), [])
    assert content(folder) == {'polygon.json': 'last'}


def test_a_folder_in_the_place_of_a_result_is_told_before_the_work(tmp_path):
    (tmp_path / 'map.yaml').mkdir()
    with pytest.raises(OutputError, match=r'map\.yaml: cannot be written: it is a folder'):
        check_folder(tmp_path)
    (failed,) = write_results(tmp_path, files(polygon_json='1'), [])
    assert str(failed).startswith('map.yaml: not written: one of an earlier run cannot be removed: ')
    assert (tmp_path / 'polygon.json').read_text() == '1'


def test_what_cannot_become_a_folder_is_told_before_the_work(tmp_path):
    (tmp_path / 'file').write_text('in the way')
    (tmp_path / 'link').symlink_to('nowhere')
    for name, cause in {
        'file': 'it is a file', 'file/out/a': f'{tmp_path}/file is a file', 'link': f'{tmp_path}/link is a link to',
        'x' * 300: 'File name too long', '/proc/a': 'No such file or directory', 'a\0b': 'embedded null byte',
    }.items():
        with pytest.raises(OutputError) as refused:
            check_folder(tmp_path / name)
        assert str(refused.value).startswith(f'{tmp_path / name}: cannot be written: {cause}'), name
    check_folder(tmp_path / 'a' / 'b')
    assert {path.name for path in tmp_path.iterdir()} == {'file', 'link'}
    with pytest.raises(OutputError, match='cannot be written: File exists'):
        write_results(tmp_path / 'file', files(polygon_json='1'), [])
