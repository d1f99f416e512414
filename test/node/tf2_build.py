"""tf2_msgs where ROS comes from PyPI, which has none: built once, into a prefix of its own beside the environment."""

import ctypes
import fcntl
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).parent.parent / 'tf2_msgs'


class NotBuilt(Exception):
    """What is missing for it."""


def environment(cache: Path) -> dict[str, str]:
    """Variables with which a process finds tf2_msgs, built in `cache` if need be; none where it is installed."""
    if importlib.util.find_spec('tf2_msgs') is not None:
        return {}
    cache.mkdir(parents=True, exist_ok=True)
    prefix = cache / f'{sys.implementation.cache_tag}-{Path(sys.prefix).name}'
    with (cache / 'lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # workers of pytest-xdist share the cache
        if not (prefix / 'built').exists():
            _build(prefix)
            (prefix / 'built').touch()
    return _found_in(prefix)


def load(variables: dict[str, str]) -> None:
    """Give this process what such variables give those that start with them: LD_LIBRARY_PATH is read at the start."""
    sys.path.insert(0, variables['PYTHONPATH'].partition(os.pathsep)[0])
    for library in Path(variables['LD_LIBRARY_PATH'].partition(os.pathsep)[0]).glob('libtf2_msgs*.so'):
        ctypes.CDLL(str(library))


def _build(prefix: Path) -> None:
    if not shutil.which('cmake'):
        raise NotBuilt('cmake is not installed')
    shutil.rmtree(prefix, ignore_errors=True)
    _run(sys.executable, '-m', 'pip', 'install', '-q', '--no-deps', '--prefix', str(prefix),
         '-r', str(SOURCE / 'build.txt'))
    # The generators are called as `python3`, and find each other by the ament index.
    both, generators = [str(prefix), sys.prefix], _found_in(prefix)
    generators |= {'AMENT_PREFIX_PATH': ':'.join(both), 'PATH': f'{sys.prefix}/bin:{os.environ["PATH"]}'}
    _run('cmake', '-S', str(SOURCE), '-B', str(prefix / 'build'), f'-DCMAKE_PREFIX_PATH={";".join(both)}',
         f'-DCMAKE_INSTALL_PREFIX={prefix}', f'-DCMAKE_INSTALL_RPATH={prefix / "lib"}',
         f'-DPython3_EXECUTABLE={sys.executable}', '-DBUILD_TESTING=OFF', **generators)
    _run('cmake', '--build', str(prefix / 'build'), '--parallel', '2', '--target', 'install', **generators)


def _found_in(prefix: Path) -> dict[str, str]:
    packages = prefix / 'lib' / f'python{sys.version_info.major}.{sys.version_info.minor}' / 'site-packages'
    paths = {'PYTHONPATH': packages, 'LD_LIBRARY_PATH': prefix / 'lib'}
    return {name: os.pathsep.join(filter(None, (str(path), os.environ.get(name)))) for name, path in paths.items()}


def _run(*command: str, **variables: str) -> None:
    done = subprocess.run(command, env={**os.environ, **variables}, text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, cwd=SOURCE)
    if done.returncode:
        raise NotBuilt(f'`{command[0]} {command[1]}` failed: ' + done.stdout[-2000:])
