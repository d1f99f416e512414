"""Every number a parameter may be given, however extreme: refused in one line, or taken in bounded time and memory."""

import resource
import tempfile
import time
from pathlib import Path

import pytest

from polymap_ros.commands import replay
from polymap_ros.parameters import specifications
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.writing import RecordingWriter

BAG = Path(__file__).parents[1] / 'bags' / 'triangle'
CHIRP = {'pulse.kind': 'chirp', 'pulse.bandwidth_hz': 4e4, 'pulse.duration_s': 1e-4}
CONSTANT, GRID = {'medium.model': 'constant'}, {'free_area.model': 'grid'}
ACTS_WITH = {
    'medium.speed_m_s': CONSTANT, 'medium.spreading_exponent': {'front_end.flat_spreading': True},
    'pulse.bandwidth_hz': CHIRP, 'pulse.duration_s': CHIRP, 'echo.blanking_m': {'front_end.mute_blanking': True},
    'front_end.wiener_noise': {'front_end.filter': 'wiener'}, 'free_area.missed': GRID, 'free_area.cell_m': GRID,
    'grid.range_step_m': GRID,
}
"""What else is set for a parameter to act."""

DOUBLES = (0.0, 5e-324, 1e-308, 1e-9, 1e9, 1e308)
INTEGERS = (0, 1, 2**31, 2**63 - 1, 2**64, 10**400)
MOST_MB = 2000
MOST_S = 15.0
NUMBERS = [spec for spec in specifications() if spec.type in (int, float)]


def extremes(spec):
    """Far out on both sides, and the bounds themselves."""
    if spec.name == 'solver.iterations':
        return [*INTEGERS, -1]  # as many as are allowed take a minute
    values = DOUBLES if spec.type is float else INTEGERS
    bounds = [spec.type(bound) for bound in (spec.minimum, spec.maximum, spec.above) if bound is not None]
    return list(dict.fromkeys([*values, *(-value for value in values), *bounds]))


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """The first pings of the triangle."""
    path = tmp_path_factory.mktemp('extreme') / 'run.mcap'
    with Recording.open(BAG) as source, RecordingWriter(path) as writer:
        for entry in source.messages(['/odom', '/echo'], end_s=10.0):
            writer.write(entry.topic, entry.message, entry.log_ns)
    return path


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('spec', NUMBERS, ids=lambda spec: spec.name)
def test_no_number_ends_in_a_traceback_or_without_end(recording, capsys, spec):
    others = {'solver.method': 'paper', 'solver.iterations': 50, **ACTS_WITH.get(spec.name, {})}
    before_mb = peak_mb()
    for value in extremes(spec):
        options = [part for name, given in {**others, spec.name: value}.items()
                   for part in ('-p', f'{name}:={str(given).lower() if isinstance(given, bool) else given}')]
        begun_s = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            status = replay.main([str(recording), '--output', f'{folder}/out', *options])
        told = [line for line in capsys.readouterr().err.splitlines()
                if line.startswith('polymap_replay: ') and not line.startswith('polymap_replay: warning: ')]
        assert status in (0, 1, 2)
        assert len(told) == (status != 0), told
        assert status != 2 or 'error: parameter ' in told[0]
        assert time.monotonic() - begun_s < MOST_S
    assert peak_mb() - before_mb < MOST_MB


@pytest.mark.slow
def test_what_is_looked_for_where_the_medium_is_wrong_stays_within_bounds(capsys, tmp_path):
    """At the end of what is allowed, other media are tried that are beyond it."""
    assert replay.main([str(BAG), '--output', str(tmp_path), '-p', 'medium.thickness_m:=1.0']) == 1
    assert 'no polygon closes' in capsys.readouterr().err


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
