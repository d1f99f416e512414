"""Compiled kernels: cached, and never older than what they were compiled from."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from polymap_ros.jit import COMPILING

CALLER = '''
from callee import inner
from polymap_ros.jit import kernel


@kernel
def outer(x):
    return inner(x) + 1.0


@kernel
def outermost(x):
    return outer(x)
'''
CALLEE = '''
from polymap_ros.jit import kernel


@kernel
def inner(x):
    return {factor} * x
'''


def answer(folder, statement='print(caller.outermost(1.0))'):
    done = subprocess.run([sys.executable, '-c', f'import caller; {statement}'], cwd=folder, capture_output=True,
                          text=True, check=True)
    return done.stdout.strip()


def test_a_cached_kernel_expires_when_a_kernel_it_calls_has_changed(tmp_path):
    pytest.importorskip('numba')
    (tmp_path / 'caller.py').write_text(CALLER)
    (tmp_path / 'callee.py').write_text(CALLEE.format(factor='2.0'))
    assert answer(tmp_path) == '3.0'
    hits = 'caller.outermost(1.0); print(sum(caller.outermost.stats.cache_hits.values()))'
    assert answer(tmp_path, hits) == '1'
    (tmp_path / 'callee.py').write_text(CALLEE.format(factor='5.00'))
    assert answer(tmp_path) == '6.0'


def test_without_a_folder_for_the_cache_it_is_compiled_all_the_same(tmp_path):
    """Neither the folder asked for, nor beside the source, nor below HOME."""
    pytest.importorskip('numba')
    (tmp_path / 'caller.py').write_text(CALLER)
    (tmp_path / 'callee.py').write_text(CALLEE.format(factor='2.0'))
    (tmp_path / '__pycache__').write_text('a file, so that no folder can be made in its place')
    nowhere = os.environ | dict.fromkeys(('NUMBA_CACHE_DIR', 'HOME', 'XDG_CACHE_HOME'), '/dev/null/nowhere')
    done = subprocess.run(
        [sys.executable, '-c', 'import caller; print(caller.outermost(1.0), caller.outermost.signatures)'],
        cwd=tmp_path, env=nowhere, capture_output=True, text=True, check=True)
    assert done.stdout == '3.0 [(float64,)]\n'
    assert done.stderr.count('compiled anew in every process') == 1  # not once for each of the three


def test_a_cache_on_a_full_disk_costs_the_cache_alone(tmp_path):
    """No file may grow beyond 1 kB: the index fits, compiled code does not."""
    pytest.importorskip('numba')
    (tmp_path / 'caller.py').write_text(CALLER)
    (tmp_path / 'callee.py').write_text(CALLEE.format(factor='2.0'))
    limit = 'import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))'
    done = subprocess.run(
        [sys.executable, '-c', f'{limit}; import caller; print(caller.outermost(1.0), caller.outermost(2.0))'],
        cwd=tmp_path, env={**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path / 'cache')}, capture_output=True, text=True,
        check=True)
    assert done.stdout == '3.0 5.0\n'
    assert done.stderr.count('compiled code cannot be kept (NUMBA_CACHE_DIR): File too large') == 1


def test_a_damaged_cache_costs_time_and_not_the_answer(tmp_path):
    pytest.importorskip('numba')
    (tmp_path / 'caller.py').write_text(CALLER)
    (tmp_path / 'callee.py').write_text(CALLEE.format(factor='2.0'))
    assert answer(tmp_path) == '3.0'
    for file in (tmp_path / '__pycache__').glob('*.nb?'):
        file.write_bytes(b'')  # the power went
    told = answer_and_warnings(tmp_path)
    assert (told.stdout, told.stderr.count('cannot be read (EOFError)')) == ('3.0\n', 1)
    hits = 'caller.outermost(1.0); print(sum(caller.outermost.stats.cache_hits.values()))'
    assert answer(tmp_path, hits) == '1'


def answer_and_warnings(folder):
    code = 'import caller; print(caller.outermost(1.0))'
    return subprocess.run([sys.executable, '-c', code], cwd=folder, capture_output=True, text=True, check=True)


REFUSED = '''
import caller
from polymap_ros import jit
try:
    with jit.only_loading():
        caller.outermost(1.0)
except jit.NotCompiled:
    print('not compiled', jit.are_kept())
print(caller.outermost(1.0))
'''


def test_what_is_only_to_be_loaded_is_not_compiled(tmp_path):
    pytest.importorskip('numba')
    (tmp_path / 'caller.py').write_text(CALLER)
    (tmp_path / 'callee.py').write_text(CALLEE.format(factor='2.0'))
    first, second = (subprocess.run([sys.executable, '-c', REFUSED], cwd=tmp_path, capture_output=True, text=True,
                                    check=True).stdout for _ in range(2))
    assert first == 'not compiled True\n3.0\n'
    assert second == '3.0\n'


TINY = '''
import json, sys, warnings
if sys.argv[1] == 'without':
    sys.modules['numba'] = None
import numpy as np
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter('always')
    from polymap_ros import jit
from polymap_ros.acoustics.ping import Ping
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.simulation import scene_file, waveforms

scene = scene_file.load_scene('triangle')
samples = waveforms.simulate(scene)
found = {'numba': jit.numba is not None, 'warnings': [str(each.message) for each in caught]}
for method in ('evidence', 'paper', 'rectangle'):
    mapper = PolygonMapper(Parameters().replaced({
        'solver.method': method, 'solver.max_edges': 4, 'solver.iterations': 20,
        'grid.range_step_m': 0.02, 'grid.angle_step_deg': 5.0, 'free_area.model': 'grid'}))
    for k in range(0, len(samples), 6):
        mapper.add_pose(k * 10**9, Pose(*scene.poses[k]))
        mapper.add_ping(Ping(k * 10**9, samples[k], 1e-6))
    polygon = mapper.solve().polygon
    found[method] = [] if polygon is None else polygon.vertices.tolist()
print(json.dumps(found))
'''


def test_without_numba_everything_works_and_says_that_it_is_slow():
    pytest.importorskip('numba')
    compiled, plain = (json.loads(subprocess.run(
        [sys.executable, '-c', TINY, how], capture_output=True, text=True, check=True).stdout)
        for how in ('with', 'without'))
    assert (compiled.pop('numba'), plain.pop('numba')) == (True, False)
    assert (compiled.pop('warnings'), plain.pop('warnings')) == (
        [], ['numba is not installed: polymap_ros runs, but slowly'])
    assert len(compiled['evidence']) == 3
    for method, vertices in compiled.items():
        np.testing.assert_allclose(plain[method], vertices, rtol=0, atol=1e-6)


TOLD = '''
from polymap_ros.jit import when_compiling
when_compiling(print)
import caller
for _ in range(2):
    caller.outermost(1.0)
'''


def test_compiling_is_told_once_and_loading_is_not(tmp_path):
    pytest.importorskip('numba')
    (tmp_path / 'caller.py').write_text(CALLER)
    (tmp_path / 'callee.py').write_text(CALLEE.format(factor='2.0'))
    first, second = (subprocess.run([sys.executable, '-c', TOLD], cwd=tmp_path, capture_output=True, text=True,
                                    check=True).stdout for _ in range(2))
    assert first == f'{COMPILING}\n'
    assert second == ''


AFTER_WARM_UP = '''
from polymap_ros.jit import when_compiling
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.warm_up import warm_up
from polymap_ros.parameters import Parameters
from polymap_ros.simulation import scene_file, waveforms

scene = scene_file.load_scene('triangle')
pings = list(waveforms.pings(scene))
for method in ('paper', 'evidence'):
    parameters = Parameters().replaced({'solver.method': method})
    told = []
    when_compiling(told.append)
    warm_up(parameters)
    print(len(told))
    when_compiling(told.append)
    mapper = PolygonMapper(parameters)
    for number, (ping, pose) in enumerate(zip(pings, scene.poses)):
        mapper.add_pose(ping.emission_ns, Pose(*pose))
        mapper.add_ping(ping)
        if number in (1, 5, 20):
            mapper.solve()
    print(len(told), mapper.solve().status)
'''


def test_nothing_is_compiled_after_the_warm_up(tmp_path):
    """The node pays before its first message."""
    pytest.importorskip('numba')
    done = subprocess.run([sys.executable, '-c', AFTER_WARM_UP], capture_output=True, text=True, check=True,
                          env=os.environ | {'NUMBA_CACHE_DIR': str(tmp_path)})
    assert done.stdout.splitlines() == ['1', '1 closed'] * 2
