"""From a damaged recording comes the right polygon, a warning or a refusal; never a polygon that is silently wrong.

All 300 flipped cases and more cuts: ``pytest -m slow test/commands/test_damaged_replay.py -s``, about ten minutes.
"""

import json
import shutil
from collections import Counter

import numpy as np
import pytest
from damage import cut, flipped, raw_messages, write_mcap

from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.writing import RecordingWriter

WITHIN_M = 0.003
"""Corners of a right answer are this close to those of the sound recording."""


@pytest.fixture(scope='module')
def sound(triangle, tmp_path_factory):
    """The triangle as a bare file, by kind: with checksums, without, and as a database, which has none."""
    folder = tmp_path_factory.mktemp('sound')
    write_mcap(folder / 'crc.mcap', raw_messages(triangle))
    shutil.copy(triangle / 'triangle.mcap', folder / 'plain.mcap')
    with Recording.open(triangle) as recording, RecordingWriter(folder / 'sqlite3.db3') as writer:
        for entry in recording.messages():
            writer.write(entry.topic, entry.message, entry.log_ns)
    return {'crc': folder / 'crc.mcap', 'plain': folder / 'plain.mcap', 'sqlite3': folder / 'sqlite3.db3'}


@pytest.fixture
def judged(call, tmp_path):
    """Replay a recording and say what came of it: right, wrong, and whether that was told."""

    def replay(path, expected=None):
        done = call('replay', path, '--output', 'out')
        lines = [line for line in done.err.replace('\r', '\n').splitlines() if line.startswith('polymap_')]
        assert 'Traceback' not in done.err
        if done.status == 2:
            assert len(lines) == 1
            return 'refused'
        found = json.loads((tmp_path / 'out' / 'polygon.json').read_text())
        counts = found['pings']
        assert counts['received'] == counts['used'] + sum(counts['dropped'].values())
        told = [f'{warning["code"]}: {warning["text"]}' for warning in found['warnings']]
        assert bool(lines) == (done.status == 1 or any(text.startswith('recording_') for text in told))
        if done.status == 1:
            return f'no polygon: {found["status"]}'
        right = expected is not None and near(found['vertices'], expected)
        return ('right' if right else 'wrong') + (', told' if told else '')

    return replay


def near(vertices, expected):
    found = np.array(vertices)
    if found.shape != np.shape(expected):
        return False
    return np.hypot(*(found[:, None] - expected).transpose(2, 0, 1)).min(axis=1).max() < WITHIN_M


@pytest.fixture(scope='module')
def corners(triangle):
    return np.array(json.loads((triangle / 'truth.json').read_text())['vertices'])


def flips(kind, seeds, sound, corners, judged, tmp_path):
    """How often what came of recordings with four flipped bits each."""
    found = Counter()
    for seed in seeds:
        path = flipped(sound[kind], tmp_path / f'{seed}{sound[kind].suffix}', seed)
        outcome = judged(path, corners)
        assert outcome != 'wrong', f'{kind} {seed} is silently wrong'
        found[outcome] += 1
        path.unlink()
    print(kind, dict(found))
    return found


@pytest.mark.parametrize('kind', ['crc', 'plain', 'sqlite3'])
def test_the_sound_recording_is_right(sound, corners, judged, kind):
    assert judged(sound[kind], corners) == 'right'


@pytest.mark.parametrize('kind', ['crc', 'plain', 'sqlite3'])
def test_flipped_bits(sound, corners, judged, tmp_path, kind):
    found = flips(kind, range(3), sound, corners, judged, tmp_path)
    if kind == 'crc':
        assert found['right'] < 3


def test_the_first_half(sound, corners, judged, tmp_path):
    assert judged(cut(sound['crc'], tmp_path / 'half.mcap', 0.5), corners) in ('right, told', 'wrong, told')


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['crc', 'plain', 'sqlite3'])
def test_flipped_bits_in_all_cases(sound, corners, judged, tmp_path, kind):
    assert sum(flips(kind, range(100), sound, corners, judged, tmp_path).values()) == 100


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['crc', 'plain', 'sqlite3'])
def test_cuts_everywhere(sound, corners, judged, tmp_path, kind):
    found = Counter()
    for share in np.linspace(0.0, 0.999, 40):
        found[judged(cut(sound[kind], tmp_path / f'cut{sound[kind].suffix}', share), corners)] += 1
    print(kind, dict(found))
    assert found['right'] == found['wrong'] == 0
