"""File systems that lack what local disks have, and disks that are full."""

import errno
import platform
import resource
import shutil
import struct
import subprocess
import sys

import pytest

from polymap_ros.errors import OutputError
from polymap_ros.results.folder import Entry, check_folder, write_results

# asm/unistd_64.h and asm-generic/unistd.h
_NUMBERS = {
    'x86_64': {'fsync': 74, 'flock': 73, 'rename': 82, 'renameat': 264, 'renameat2': 316, 'chmod': 90, 'fchmod': 91},
    'aarch64': {'fsync': 82, 'flock': 32, 'renameat': 38, 'renameat2': 276, 'fchmod': 52, 'fchmodat': 53},
}
_LOAD, _JUMP_IF_EQUAL, _RETURN, _ERRNO, _ALLOW = 0x20, 0x15, 0x06, 0x00050000, 0x7FFF0000
_PRELUDE = """
import ctypes, sys
program = bytes.fromhex({program!r})
buffer = ctypes.create_string_buffer(program)
class Filter(ctypes.Structure):
    _fields_ = [('length', ctypes.c_ushort), ('filter', ctypes.c_void_p)]
libc = ctypes.CDLL(None)
assert libc.prctl(38, 1, 0, 0, 0) == 0
if libc.prctl(22, 2, ctypes.byref(Filter(len(program) // 8, ctypes.addressof(buffer)))):
    sys.exit(77)
"""


def run_refused(code, refused, *arguments):
    """Run `code` in a process whose kernel answers calls with an error: names of calls to numbers of errors."""
    numbers = _NUMBERS.get(platform.machine())
    if sys.platform != 'linux' or numbers is None:
        pytest.skip('system calls are refused by seccomp of Linux')
    steps = [(_LOAD, 0, 0, 0)]
    for name, error in refused.items():
        if name in numbers:
            steps += [(_JUMP_IF_EQUAL, 0, 1, numbers[name]), (_RETURN, 0, 0, _ERRNO | error)]
    program = b''.join(struct.pack('HBBI', *step) for step in [*steps, (_RETURN, 0, 0, _ALLOW)])
    done = subprocess.run([sys.executable, '-c', _PRELUDE.format(program=program.hex()) + code, *map(str, arguments)],
                          capture_output=True, text=True, timeout=60, check=False)
    if done.returncode == 77:
        pytest.skip('this kernel has no seccomp')
    return done


RENAMES = 'rename', 'renameat', 'renameat2'
CODE = """
import sys
from pathlib import Path
from polymap_ros.results.folder import Entry, check_folder, write_results
check_folder(Path(sys.argv[1]))
for run in ('old', 'new'):
    entries = [Entry.of(name, run.encode) for name in ('polygon.json', 'state.npz', 'map.pgm')]
    unwritten = write_results(Path(sys.argv[1]), entries[:2], entries[2:])
    print(*unwritten)
"""


def content(folder):
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.mark.parametrize('refused', [
    dict.fromkeys(('fsync',), errno.EINVAL), dict.fromkeys(('flock',), errno.ENOLCK),
    dict.fromkeys(('fsync', 'flock', *RENAMES), errno.ENOSYS), dict.fromkeys(RENAMES, errno.EXDEV),
    dict.fromkeys(('fsync', 'flock', 'chmod', 'fchmod', 'fchmodat', *RENAMES), errno.EOPNOTSUPP)])
def test_what_the_file_system_does_not_offer_is_no_error(tmp_path, refused):
    done = run_refused(CODE, refused, tmp_path / 'out')
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, '', '')
    assert content(tmp_path / 'out') == dict.fromkeys(('polygon.json', 'state.npz', 'map.pgm'), 'new')
    assert [path.name for path in tmp_path.iterdir()] == ['out']


def test_a_disk_that_fails_is_an_error(tmp_path):
    done = run_refused(CODE, {'fsync': errno.EIO}, tmp_path / 'out')
    assert done.stderr.splitlines()[-1] == (
        f'polymap_ros.errors.OutputError: {tmp_path}/out: cannot be written: Input/output error; choose another folder')


@pytest.fixture
def limited():
    """A function that limits the size of files, as a full disk or a quota does [bytes]."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_costs_what_does_not_fit(tmp_path, limited):
    large = [Entry.of(name, lambda: bytes(5000)) for name in ('state.npz', 'map.pgm')]
    small = [Entry.of(name, lambda: b'small') for name in ('polygon.json', 'map.yaml')]
    limited(4096)
    unwritten = write_results(tmp_path, [small[0], large[0]], [large[1], small[1]])
    cause = 'File too large; raise the limit of the size of files (ulimit -f)'
    assert [*map(str, unwritten)] == [f'state.npz: not written: {cause}', f'map.pgm: not written: {cause}']
    assert content(tmp_path) == {'polygon.json': 'small', 'map.yaml': 'small'}
    with pytest.raises(OutputError) as refused:
        write_results(tmp_path, large, [])
    assert str(refused.value) == f'{tmp_path}: cannot be written: {cause}, or choose another folder'
    assert content(tmp_path) == {'polygon.json': 'small', 'map.yaml': 'small'}


def test_a_name_as_long_as_they_get(tmp_path):
    name = 'ö' * 127  # 254 bytes of the 255
    assert write_results(tmp_path / name, [Entry.of('polygon.json', lambda: b'1')], []) == []
    assert content(tmp_path / name) == {'polygon.json': '1'}


@pytest.fixture
def disk(tmp_path):
    """A function that gives a small disk of so many kilobytes."""
    folder = tmp_path / 'disk'
    folder.mkdir()
    mounted = []

    def mount(kilobytes, files=100):
        how = ['mount', '-t', 'tmpfs', '-o', f'size={kilobytes}k,nr_inodes={files}', 'tmpfs', str(folder)]
        if shutil.which('mount') is None or subprocess.run(how, capture_output=True, check=False).returncode:
            pytest.skip('nothing may be mounted here')
        mounted.append(folder)
        return folder

    yield mount
    for each in mounted:
        subprocess.run(['umount', str(each)], check=True)


def sized(sizes):
    return [Entry.of(name, lambda size=size: bytes(size)) for name, size in sizes.items()]


def test_a_second_run_has_the_room_of_the_first_one(disk):
    """Of which nothing is touched where not even the polygon fits."""
    folder = disk(64) / 'out'
    first = sized({'polygon.json': 4096, 'state.npz': 32_000, 'map.pgm': 12_000})
    assert write_results(folder, first[:2], first[2:]) == []
    with pytest.raises(OutputError, match='No space left on device'):
        write_results(folder, sized({'polygon.json': 20_000}), [])
    assert {path.name for path in folder.iterdir()} == {'polygon.json', 'state.npz', 'map.pgm'}
    second = sized({'polygon.json': 5000, 'state.npz': 36_000})
    assert write_results(folder, second, []) == []
    assert {path.name: path.stat().st_size for path in folder.iterdir()} == {'polygon.json': 5000, 'state.npz': 36_000}


def test_what_does_not_fit_takes_no_room_of_what_does(disk):
    folder = disk(64) / 'out'
    entries = sized({'polygon.json': 4096, 'state.npz': 200_000, 'polygon.png': 200_000, 'map.yaml': 30_000})
    assert [each.names[0] for each in write_results(folder, entries[:2], entries[2:])] == ['state.npz', 'polygon.png']
    assert {path.name for path in folder.iterdir()} == {'polygon.json', 'map.yaml'}


def test_a_disk_that_takes_no_more_files_is_told_before_the_work_unless_the_answer_fits(disk):
    folder = disk(1000, files=10)
    entries = sized({'polygon.json': 1, 'state.npz': 1})
    for number in range(10):
        try:
            check_folder(folder / 'maps' / 'out')
        except OutputError:
            break
        assert write_results(folder / 'maps' / 'out', entries, []) == []
        shutil.rmtree(folder / 'maps')
        (folder / str(number)).touch()
    assert number > 0
    assert not (folder / 'maps').exists()


@pytest.fixture
def unremovable():
    """A function that makes a file one that nobody may remove."""
    made = []

    def protect(path):
        if shutil.which('chattr') is None or subprocess.run(
                ['chattr', '+i', path], capture_output=True, check=False).returncode:
            pytest.skip('files cannot be made immutable here')
        made.append(path)

    yield protect
    for path in made:
        subprocess.run(['chattr', '-i', path], check=True)


@pytest.mark.parametrize('name', ['polygon.json', 'polygon.png'])
def test_an_earlier_result_that_may_not_be_removed_is_told_before_the_work(tmp_path, unremovable, name):
    write_results(tmp_path, sized({'polygon.json': 1, 'state.npz': 1}), sized({'polygon.png': 1}))
    unremovable(tmp_path / name)
    cause = 'it is of an earlier run, and cannot be removed: Operation not permitted; let its owner do that'
    for attempt in (check_folder, lambda folder: write_results(folder, sized({'polygon.json': 2, 'state.npz': 2}), [])):
        with pytest.raises(OutputError) as refused:
            attempt(tmp_path)
        assert str(refused.value) == f'{tmp_path / name}: cannot be written: {cause}, or choose another folder'
        assert {path.stat().st_size for path in tmp_path.iterdir()} == {1}
