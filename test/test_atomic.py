"""Temporary folders: removed by whoever comes next once their process is dead, and never before."""

import os
import signal
import subprocess
import sys

import pytest

from polymap_ros.atomic import staging

HOLDER = """
import sys, time
from pathlib import Path
from polymap_ros.atomic import staging

with staging(Path(sys.argv[1])) as stage:
    (stage / 'half').write_text('written')
    print(stage, flush=True)
    time.sleep(600)
"""

HURRIED = """
import sys
from pathlib import Path
from polymap_ros.atomic import staging

for _ in range(300):
    with staging(Path(sys.argv[1])) as stage:
        (stage / 'half').write_text('written')
        assert (stage / 'half').read_text() == 'written'
"""


@pytest.fixture
def holder(tmp_path):
    """A process that is in the middle of writing ``result``."""
    process = subprocess.Popen([sys.executable, '-c', HOLDER, str(tmp_path / 'result')], stdout=subprocess.PIPE,
                               text=True)
    assert process.stdout is not None
    yield process, tmp_path / process.stdout.readline().strip()
    process.kill()
    process.wait()
    process.stdout.close()


def test_folder_of_a_living_process_stays(holder, tmp_path):
    _, theirs = holder
    with staging(tmp_path / 'result') as ours:
        assert ours != theirs
        assert (theirs / 'half').read_text() == 'written'
    assert list(tmp_path.iterdir()) == [theirs]


def test_folder_of_a_killed_process_is_removed_by_the_next(holder, tmp_path):
    process, theirs = holder
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert (theirs / 'half').exists()
    with staging(tmp_path / 'result') as ours:
        assert list(tmp_path.iterdir()) == [ours]
    assert list(tmp_path.iterdir()) == []


def test_what_only_looks_like_a_temporary_folder_stays(tmp_path):
    theirs = tmp_path / 'theirs'
    theirs.mkdir()
    (theirs / 'file').touch()
    (tmp_path / '.result-holidays').mkdir()
    (tmp_path / '.other.polymap-abcdefgh').mkdir()
    (tmp_path / '.result.polymap-file').touch()
    (tmp_path / '.result.polymap-link').symlink_to(theirs)
    before = set(tmp_path.rglob('*'))
    with staging(tmp_path / 'result'):
        pass
    assert set(tmp_path.rglob('*')) == before


def test_names_with_wildcards_clear_their_own_only(tmp_path):
    (tmp_path / '.save1.polymap-abcdefgh').mkdir()
    (tmp_path / '.save[1].polymap-abcdefgh').mkdir()
    with staging(tmp_path / 'save[1]'):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ['.save1.polymap-abcdefgh']


def test_many_at_once_do_not_take_each_others_folders(tmp_path):
    """Every process clears what it finds while the others are making theirs."""
    processes = [subprocess.Popen([sys.executable, '-c', HURRIED, str(tmp_path / 'result')]) for _ in range(4)]
    assert [process.wait(60) for process in processes] == [0] * 4
    assert list(tmp_path.iterdir()) == []
