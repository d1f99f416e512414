"""A start without compiled code: all there at once, nothing lost, and the process that compiles ends with the node.

Most of the code is loaded here, and one small kernel is left to compile; signals hold back the process that does.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')
pytest.importorskip('numba')

from polymap_ros.node.factory import message_class
from polymap_ros.results.arrays import read_state

RELIABLE = [part for topic in ('odom', 'echo')
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable',
                         '-p', f'qos_overrides./{topic}.subscription.depth:=1000')]
TRIGGER = 'std_srvs/srv/Trigger'
LEFT_OUT = 'ranging._peak_from-*'
WARM = '''
import json
from numba.core.caching import _CacheLocator
from polymap_ros import jit
from polymap_ros.mapping.warm_up import warm_up
from polymap_ros.parameters import Parameters
warm_up(Parameters())
print(json.dumps({
    kernel._cache.cache_path: _CacheLocator.get_suitable_cache_subpath(kernel.py_func.__code__.co_filename)
    for kernel in jit._KERNELS}))
'''


@pytest.fixture(scope='module')
def folders() -> dict[str, str]:
    """Where compiled code is, and where below NUMBA_CACHE_DIR the same would be."""
    done = subprocess.run([sys.executable, '-c', WARM], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.fixture
def almost_compiled(folders, tmp_path, monkeypatch) -> Path:
    """A cache that lacks one kernel."""
    cache = tmp_path / 'cache'
    for folder, name in folders.items():
        (cache / name).mkdir(parents=True)
        for file in Path(folder).glob('*.nb?'):
            if not file.match(LEFT_OUT):
                (cache / name / file.name).write_bytes(file.read_bytes())
    assert not list(cache.rglob(LEFT_OUT))
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(cache))
    return cache


def children(process) -> list[int]:
    """Processes that it has started, and that have become what they are to be."""
    pids = [int(pid) for task in Path(f'/proc/{process.popen.pid}/task').iterdir()
            for pid in (task / 'children').read_text().split()]
    return [pid for pid in pids if b'node.compiling' in Path(f'/proc/{pid}/cmdline').read_bytes()]


def compiling(peer, node) -> int:
    """Wait for the process that compiles and hold it back; return its number."""
    peer.spin_until(lambda: children(node), 'a process that compiles')
    os.kill(child := children(node)[0], signal.SIGSTOP)
    return child


def is_gone(pid) -> bool:
    return not Path(f'/proc/{pid}').exists() or ') Z ' in Path(f'/proc/{pid}/stat').read_text()


def test_all_is_there_at_once_and_nothing_is_lost(peer, start, riding, almost_compiled, tmp_path):
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path}', '-p', 'odometry.queue_size:=5',
                 ready='compiling for this machine')
    child, values, ride = compiling(peer, node), peer.diagnostics(), riding()
    ride.publish(0, 30)
    peer.spin_until(lambda: values().get('pings waiting') == '30', '30 pings that wait')
    found = values()
    assert found['message'].startswith('starting: compiling, ')
    assert (found['level'], found['pings used'], found['pings received']) == ('0', '0', '30')
    assert not any(name.startswith('pings dropped') for name in found)
    saved = Path(peer.call('/polymap_node/save', TRIGGER).message)
    polygon = json.loads((saved / 'polygon.json').read_text())
    assert (polygon['status'], polygon['warnings'][0]['text'].partition(';')[0]) == (
        'open', 'nothing has been solved yet: 30 pings wait for the end of the start')
    assert len(read_state(saved / 'state.npz')['queue.placed_ns']) == 30
    os.kill(child, signal.SIGCONT)
    node.wait_for_line('ready:')
    peer.until_used(values, 30)
    peer.spin_until(lambda: values().get('status') == 'closed', 'a polygon')
    assert list(almost_compiled.rglob(LEFT_OUT))
    assert node.stop() == 0


def test_reset_and_pause_while_compiling(peer, start, riding, almost_compiled):
    node = start('--ros-args', *RELIABLE, ready='compiling for this machine')
    child, values, ride = compiling(peer, node), peer.diagnostics(), riding()
    ride.publish(0, 5)
    peer.spin_until(lambda: values().get('pings waiting') == '5', '5 pings that wait')
    assert peer.call('/polymap_node/reset', TRIGGER).success
    peer.spin_until(lambda: values().get('pings received') == '0', 'none received since the reset')
    assert peer.call('/polymap_node/pause', 'std_srvs/srv/SetBool', data=True).success
    ride.publish(5, 8)
    peer.spin_until(lambda: values().get('pings dropped: paused') == '3', 'the drops')
    assert values()['message'].startswith('starting: compiling, ')
    assert values()['message'].endswith('; paused')
    peer.call('/polymap_node/pause', 'std_srvs/srv/SetBool', data=False)
    ride.publish(8, 12)
    os.kill(child, signal.SIGCONT)
    peer.until_used(values, 4)
    assert node.stop() == 0
    told = [line.partition('polymap_node]: ')[2] for line in node.lines if '[INFO]' in line]
    assert [line.partition(':')[0].partition(',')[0] for line in told] == [
        'parameters', 'compiling for this machine', 'reset', 'paused', 'running', 'ready']


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_compiling_ends_both(peer, start, almost_compiled, number):
    node = start('--ros-args', ready='compiling for this machine')
    child = compiling(peer, node)
    assert node.stop(number) == 0
    assert is_gone(child)
    assert not any('Traceback' in line or 'failed' in line for line in node.lines)


def test_the_process_that_compiles_ends_with_a_killed_node(peer, start, almost_compiled):
    node = start('--ros-args', ready='compiling for this machine')
    child = compiling(peer, node)
    node.kill()
    os.kill(child, signal.SIGCONT)
    peer.spin_until(lambda: is_gone(child), 'the end of the process that compiled')


def test_a_killed_process_leaves_the_compiling_to_the_node(peer, start, almost_compiled):
    node = start('--ros-args', ready='compiling for this machine')
    os.kill(compiling(peer, node), signal.SIGKILL)
    assert node.wait_for_line('[WARN]').endswith(
        'the process that compiles failed (ended by SIGKILL): compiling in this one')
    node.wait_for_line('ready:')
    assert node.stop() == 0


def test_a_compiler_that_fails_is_told_in_a_line(peer, start, almost_compiled, tmp_path, monkeypatch):
    """numba that can load, and not compile."""
    (tmp_path / 'broken').mkdir()
    (tmp_path / 'broken' / 'sitecustomize.py').write_text(
        'from numba.core import codegen\n'
        'def broken(library):\n    raise RuntimeError("LLVM is broken")\n'
        'codegen.CPUCodeLibrary.finalize = broken\n')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path / 'broken'))
    node = start('--ros-args', ready='')
    assert node.end() == 2
    assert 'the process that compiles failed (RuntimeError: LLVM is broken' in '\n'.join(node.lines)
    assert node.lines[-1].startswith('polymap_node: error: cannot compile for this machine: RuntimeError: LLVM is')
    assert not any('Traceback' in line for line in node.lines)


def test_where_nothing_can_be_kept_the_node_compiles_beside_the_messages(peer, start, monkeypatch):
    """And ends at once though it compiles."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', '/dev/null/nowhere')
    monkeypatch.setenv('NUMBA_CACHE_LOCATOR_CLASSES', 'UserProvidedCacheLocator')
    node = start('--ros-args', ready='compiling for this machine')
    values = peer.diagnostics()
    peer.spin_until(lambda: values().get('message', '').startswith('starting: compiling'), 'diagnostics')
    assert children(node) == []
    begun_s = time.monotonic()
    assert node.stop() == 0
    assert time.monotonic() - begun_s < 10.0
    assert sum('compiled anew in every process' in line for line in node.lines) == 1


@pytest.mark.slow
def test_with_an_empty_cache_nothing_is_lost_at_the_defaults(peer, start, riding, tmp_path, monkeypatch):
    """Odometry at 200 Hz and 20 pings a second for 40 s, and diagnostics at least every 2 s."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
    start('--ros-args', ready='parameters:')
    heard: list[float] = []
    peer.node.create_subscription(message_class('diagnostic_msgs/msg/DiagnosticArray'), '/diagnostics',
                                  lambda _: heard.append(time.monotonic()), 10)
    values, ride = peer.diagnostics(), riding()
    begun_s = time.monotonic()
    for k in range(8000):
        peer.spin_until(lambda due_s=begun_s + 0.005 * k: time.monotonic() >= due_s, 'the time of the next pose')
        ride.pose(5_000_000 * (k + 1), k // 10 % len(ride.poses))
        if k % 10 == 0:
            ride.ping(5_000_000 * (k + 1), ride.samples[k // 10 % len(ride.samples)])
    peer.spin_until(lambda: values().get('pings used') == '800', '800 pings used', timeout_s=300.0)
    assert (values()['odometry received'], values()['pings received']) == ('8000', '800')
    assert max(np.diff(heard)) < 2.0
