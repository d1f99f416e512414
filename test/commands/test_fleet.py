"""Many recordings with one command: the bytes of single runs, and the rest done whatever happens to one."""

import importlib
import json
import os
import shutil
import signal
import subprocess
import sys

import pytest

from polymap_ros.commands import fleet

FILES = ('polygon.json', 'state.npz', 'trajectory.tum', 'map.pgm', 'map.yaml', 'beam_map.npz')


ONE_THREAD = {f'{library}_NUM_THREADS': '1' for library in ('OMP', 'OPENBLAS', 'MKL')}
"""As Dask's nanny starts its workers: the last digits of OpenBLAS's results depend on the number of its threads."""


def different(one, other):
    """Files that differ by more than the name of the recording."""
    def content(folder, name):
        named = f'"recording": "{json.loads((folder / FILES[0]).read_text())["recording"]}"'
        return (folder / name).read_bytes().replace(named.encode(), b'')

    return [name for name in FILES if content(one, name) != content(other, name)]


def files_below(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob('*') if path.is_file()}


@pytest.fixture
def copies(triangle, tmp_path):
    """So many copies of one recording, each with a name of its own."""
    def make(number):
        return [shutil.copy(triangle / 'triangle.mcap', tmp_path / f'drive{index}.mcap') for index in range(number)]
    return make


def test_jobs_give_the_bytes_of_single_runs_and_report_what_is_bad(run, triangle, copies, tmp_path):
    evidence = ('-p', 'solver.max_edges:=5', '--save-map')
    (tmp_path / 'broken.mcap').write_bytes(b'no recording')
    done = run('replay', 'broken.mcap', triangle, *copies(1), '--jobs', '2', '--output', 'out', *evidence)
    assert done.status == 2
    assert done.complaint.startswith('polymap_replay: error: broken.mcap: ')
    assert 'recordings: 100%' in done.err
    assert '3/3' in done.err
    assert 'reading' not in done.err
    assert done.out.count('closed: 3 edges') == done.out.count('; results in out') == 2
    assert done.out.splitlines()[-1] == '2 done, 0 open, 1 failed; out/summary.csv'
    rows = (tmp_path / 'out' / 'summary.csv').read_text().splitlines()
    assert [row.split(',')[:2] for row in rows] == [
        ['name', 'status'], ['broken', 'failed'], ['triangle', 'done'], ['drive0', 'done']]
    single = run('replay', triangle, '--output', 'single', *evidence)
    assert single.status == 0
    for name in ('triangle', 'drive0'):
        assert different(tmp_path / 'out' / name, tmp_path / 'single') == []
    assert not (tmp_path / 'out' / 'broken').exists()


@pytest.mark.parametrize(('number', 'status', 'word'), [
    (signal.SIGINT, 130, 'interrupted'), (signal.SIGTERM, 143, 'terminated'), (signal.SIGHUP, 129, 'hung up')])
def test_a_signal_ends_all_processes_and_nothing_is_half_written(start, copies, tmp_path, number, status, word):
    """The first recording is short and over; two that would take for ever are under way, another one waits."""
    recordings = copies(3)
    (tmp_path / 'broken.mcap').write_bytes(b'no recording')
    before = files_below(tmp_path)
    process = start('replay', 'broken.mcap', *recordings, '--jobs', '2', '--output', 'out',
                    '-p', 'solver.method:=paper', '-p', 'solver.iterations:=1000000')
    seen = b''
    while b'broken.mcap' not in seen:
        seen += process.stderr.read1(4096)
    os.killpg(process.pid, number) if number != signal.SIGTERM else process.send_signal(number)
    out, err = process.communicate(timeout=60)  # which ends when every process has closed stdout
    assert process.returncode == status, seen + err
    assert b'Traceback' not in seen + err
    assert err.decode().replace('\r', '\n').splitlines()[-1] == f'polymap_replay: {word}'
    assert out == b'0 done, 0 open, 1 failed, 3 not finished; out/summary.csv\n'
    assert files_below(tmp_path) == before | {'out/summary.csv'}
    _, broken = (tmp_path / 'out' / 'summary.csv').read_text().splitlines()
    assert broken.startswith('broken,failed,')


JOB = '''
import os, signal, time
from polymap_ros.commands import console

def job(name, marker, how):
    """As `how` says: be done, or take the process with it, once or whenever it is tried."""
    if how == 'always' or (how == 'once' and not marker.exists()):
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if how in ('r', 'w'):  # wait for the other, who has to be there at the same time
        signal.alarm(30)
        open(marker.parent / 'meeting', how).close()
        signal.alarm(0)
    if how == 'deaf':  # to what is raised in a finalizer
        class Finalized:
            def __del__(self):
                marker.touch()
                os.kill(os.getppid(), signal.SIGTERM)
                time.sleep(60)
        Finalized()
        time.sleep(60)
    console.tell(f'{name} is done')
    return console.DONE
'''


def lost(name, marker, how, reason):
    """Return the status of a job that told none."""
    return 2


def abrupt_jobs(tmp_path, monkeypatch, ways):
    (tmp_path / 'abrupt.py').write_text(JOB)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, 'abrupt', raising=False)
    job = importlib.import_module('abrupt').job
    return job, [(f'job {index}', tmp_path / str(index), each) for index, each in enumerate(ways)]


@pytest.mark.parametrize(('how', 'done'), [('once', (0, 1, 2, 3)), ('always', (0, 2, 3))])
def test_a_process_that_ends_abruptly_costs_one_recording_at_most(tmp_path, monkeypatch, capfd, how, done):
    job, jobs = abrupt_jobs(tmp_path, monkeypatch, ('', how, '', ''))
    statuses = fleet.run_all('polymap_replay', job, jobs, 2, None, lost)
    assert statuses == [0 if index in done else 2 for index in range(4)]
    out, err = capfd.readouterr()
    assert sorted(out.split('\n')[:-1]) == [f'job {index} is done' for index in done]
    complaints = [line for line in err.replace('\r', '\n').splitlines() if line.startswith('polymap_replay')]
    text = 'polymap_replay: error: job 1: the process that worked on it ended abruptly, as where memory runs out'
    assert complaints == ([] if 1 in done else [text])


def test_after_a_process_ended_abruptly_as_many_work_at_once(tmp_path, monkeypatch, capfd):
    os.mkfifo(tmp_path / 'meeting')
    job, jobs = abrupt_jobs(tmp_path, monkeypatch, ('once', 'r', 'w'))
    assert fleet.run_all('polymap_replay', job, jobs, 2, None, lost) == [0, 0, 0]
    assert sorted(capfd.readouterr().out.split('\n')[:-1]) == ['job 0 is done', 'job 1 is done', 'job 2 is done']


def test_a_process_that_is_deaf_to_the_first_signal_ends_with_the_others(tmp_path):
    """Python ignores what a signal raises while an object is finalized, and goes on; nobody has to read of it."""
    (tmp_path / 'abrupt.py').write_text(JOB)
    code = ('import sys; from pathlib import Path; from abrupt import job; '
            'from polymap_ros.commands import console, fleet; '
            "jobs = [(str(k), Path(f'finalized{k}'), 'deaf') for k in range(2)]; "
            "statuses = lambda: fleet.run_all('polymap_replay', job, jobs, 2, None, print); "
            "sys.exit(console.execute('polymap_replay', lambda: max(statuses())))")
    done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(tmp_path)},
                          capture_output=True, text=True, timeout=50, check=False)
    assert done.returncode == 143, done.stderr
    assert 'polymap_replay: terminated' in done.stderr
    assert list(tmp_path.glob('finalized*'))
    assert 'Traceback' not in done.stderr


def test_a_cluster_that_is_not_there_is_one_line_and_nothing_is_touched(call, triangle, copies, tmp_path, monkeypatch):
    monkeypatch.setattr(fleet, 'WAIT_S', 0.5)
    pytest.importorskip('distributed')
    for address in ('tcp://127.0.0.1:9', 'nonsense://x'):
        done = call('replay', triangle, '--scheduler', address)
        assert done.status == 2
        assert done.complaint.startswith(f'polymap_replay: error: --scheduler {address}: no Dask scheduler answers')
    summary, index = tmp_path / 'out' / 'summary.csv', tmp_path / 'out' / 'index.html'
    summary.parent.mkdir()
    summary.write_text('name,status,warnings,edges,area,pings,seconds,error\ndrive0,done,,3,1,9,1.0,\n')
    index.write_text('<meta name="generator" content="polymap_ros">')
    before = summary.read_bytes(), index.read_bytes()
    done = call('replay', triangle, *copies(1), '--report', '--scheduler', 'tcp://127.0.0.1:9', '--output', 'out')
    assert (done.status, summary.read_bytes(), index.read_bytes()) == (2, *before)
    monkeypatch.setitem(sys.modules, 'distributed', None)
    done = call('replay', triangle, '--scheduler', 'tcp://127.0.0.1:9')
    assert (done.status, done.complaint) == (
        2, "polymap_replay: error: --scheduler needs Dask: pip install 'polymap_ros[fleet]'")


@pytest.fixture
def cluster(tmp_path):
    """A scheduler with two workers of one thread, all processes of their own; its address, and them."""
    pytest.importorskip('distributed')
    file = tmp_path / 'scheduler.json'
    started = []

    def begin(name, *arguments):
        with (tmp_path / f'{name}-{len(started)}.log').open('wb') as log:
            started.append(subprocess.Popen(
                [sys.executable, '-m', 'dask', name, '--scheduler-file', file, *arguments], cwd=tmp_path, stdout=log,
                stderr=subprocess.STDOUT, env={**os.environ, **ONE_THREAD}))
        return started[-1]

    scheduler = begin('scheduler', '--host', '127.0.0.1', '--port', '0', '--no-dashboard')
    workers = [begin('worker', '--nthreads', '1', '--no-nanny', '--no-dashboard', '--host', '127.0.0.1')
               for _ in range(2)]
    from distributed import Client

    with Client(scheduler_file=str(file), timeout=60.0, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60.0)
    yield json.loads(file.read_text())['address'], workers, scheduler
    for process in started:
        process.kill()
        process.wait()


def test_every_recording_has_its_result_though_a_worker_is_killed(start, run, cluster, copies, triangle, tmp_path):
    address, workers, _ = cluster
    recordings = copies(5)
    process = start('replay', *(path.relative_to(tmp_path) for path in recordings), 'missing.mcap', '--output', 'out',
                    '--save-map', '--scheduler', address)
    first = process.stdout.readline()
    assert first, process.stderr.read()  # the first one is done, the others are shared out
    workers[0].kill()
    err = process.communicate(timeout=120)[1].decode()
    assert 'Traceback' not in err
    complaints = [line for line in err.replace('\r', '\n').splitlines() if line.startswith('polymap_')]
    assert (process.returncode, complaints) == (
        2, [f'polymap_replay: error: {tmp_path}/missing.mcap: no such recording']), err
    assert run('replay', triangle, '--output', 'single', '--save-map').status == 0
    for path in recordings:
        assert different(tmp_path / 'out' / path.stem, tmp_path / 'single') == []
    rows = (tmp_path / 'out' / 'summary.csv').read_text().splitlines()[1:]
    assert [row.split(',')[:2] for row in rows] == [
        *([path.stem, 'done'] for path in recordings), ['missing', 'failed']]


def test_a_scheduler_that_is_lost_on_the_way_is_a_line_for_each_recording(start, cluster, copies):
    address, _, scheduler = cluster
    process = start('replay', *copies(5), '--output', 'out', '--scheduler', address)
    first = process.stdout.readline()
    assert first, process.stderr.read()
    scheduler.kill()
    err = process.communicate(timeout=120)[1].decode()
    assert 'Traceback' not in err
    complaints = [line for line in err.replace('\r', '\n').splitlines() if line.startswith('polymap_')]
    assert process.returncode == 2, err
    assert complaints
    reason = 'the scheduler was lost before it told how this ended'
    assert [line for line in complaints if not line.endswith(reason)] == []
