"""Compiled kernels: cached, and never older than what they were compiled from."""

import subprocess
import sys

import pytest

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
