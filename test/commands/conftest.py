"""The commands as real processes, and recordings with something wrong in them."""

import copy
import importlib
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from polymap_ros.jit import COMPILING
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.writing import RecordingWriter


class Outcome(NamedTuple):
    status: int
    out: str
    err: str

    @property
    def complaint(self):
        """The one line on stderr that is no progress bar, nor tells of a first start."""
        lines = [line for line in self.err.replace('\r', '\n').splitlines()
                 if line.startswith('polymap_') and not line.endswith(COMPILING)]
        assert len(lines) == 1, self.err
        return lines[0]


def command_line(name, *arguments):
    code = f'import sys; from polymap_ros.commands.{name} import main; sys.exit(main())'
    return [sys.executable, '-c', code, *map(str, arguments)]


@pytest.fixture
def run(tmp_path):
    """Run a command in a folder of its own; a traceback is a failure of every test. Streams may be other than pipes."""

    def call(name, *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE):
        done = subprocess.run(command_line(name, *arguments), cwd=tmp_path, stdout=stdout, stderr=stderr, text=True,
                              timeout=300, check=False)
        assert 'Traceback' not in (done.stderr or ''), done.stderr
        return Outcome(done.returncode, done.stdout, done.stderr)

    return call


@pytest.fixture
def call(tmp_path, monkeypatch, capfd):
    """Call a command's main() in a folder of its own, for all that does not need another process."""
    monkeypatch.chdir(tmp_path)

    def run_main(name, *arguments):
        main = importlib.import_module(f'polymap_ros.commands.{name}').main
        capfd.readouterr()
        status = main([*map(str, arguments)])
        return Outcome(status, *capfd.readouterr())

    return run_main


@pytest.fixture
def start(tmp_path):
    """Start a command in a process group of its own, whose stderr is read while it works."""
    started = []

    def call(name, *arguments):
        process = subprocess.Popen(command_line(name, *arguments), cwd=tmp_path, stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, start_new_session=True, env={**os.environ})
        started.append(process)
        return process

    yield call
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture(scope='session')
def triangle(tmp_path_factory) -> Path:
    """The built-in triangle as `polymap_simulate` records it, with its truth."""
    path = tmp_path_factory.mktemp('recordings') / 'triangle'
    subprocess.run(command_line('simulate', 'triangle', '--output', path), check=True, capture_output=True, timeout=120)
    return path


@pytest.fixture
def altered(triangle, tmp_path):
    """Rewrite the triangle: `change(topic, index, message)` gives (topic, message) pairs in place of each message."""

    def rewrite(change, name='altered', storage='mcap') -> Path:
        counts: dict[str, int] = {}
        with Recording.open(triangle) as recording, RecordingWriter(tmp_path / name, storage) as writer:
            for entry in recording.messages():
                index = counts.setdefault(entry.topic, 0)
                counts[entry.topic] += 1
                for topic, message in change(entry.topic, index, copy.deepcopy(entry.message)):
                    writer.write(topic, message, entry.log_ns)
        return tmp_path / name

    return rewrite
