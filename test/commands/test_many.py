"""What many recordings leave: a row for each that is over, whatever becomes of the others."""

import csv
import json
import shlex
import shutil
import signal
import subprocess
import sys

import pytest

from polymap_ros.commands import console, fleet, replaying
from polymap_ros.commands.ledger import COLUMNS, Ledger
from polymap_ros.commands.replaying import Outcome
from polymap_ros.errors import UsageError

FAST = ('-p', 'solver.method:=paper', '-p', 'solver.iterations:=20')


def rows(path):
    with path.open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


def outcome(path, status=0, answer='closed', **changes):
    return Outcome(path, path.parent / 'out' / path.stem, status, answer, **changes)


@pytest.fixture
def drives(tmp_path):
    return {tmp_path / f'{name}.mcap': name for name in ('a', 'b', 'c', 'd', 'e')}


def test_every_row_is_there_as_soon_as_its_recording_is_over(tmp_path, drives, capsys):
    a, b, c, d, _ = drives
    ledger = Ledger(tmp_path, drives)
    assert (tmp_path / 'summary.csv').read_text() == ','.join(COLUMNS) + '\n'
    ledger.add(outcome(d, 2, '', error='d.mcap: no such "recording",\nas it were'))
    ledger.add(outcome(b, 1, 'ambiguous', warnings=('mirror_image', 'weak_edge', 'mirror_image'), seconds=1.26))
    assert [row['name'] for row in rows(tmp_path / 'summary.csv')] == ['b', 'd']  # as they were given
    ledger.add(outcome(a, edges=4, area_m2=1.23456789, pings_received=9, pings_used=7))
    ledger.add(outcome(c, 2, edges=3, area_m2=0.5, error='c/polygon.png: not written: no'))
    assert [list(row.values()) for row in rows(tmp_path / 'summary.csv')] == [
        ['a', 'done', '', '4', '1.23457', '7', '0.0', ''],
        ['b', 'open', 'mirror_image;weak_edge', '', '', '0', '1.3', ''],
        ['c', 'done', '', '3', '0.5', '0', '0.0', 'c/polygon.png: not written: no'],
        ['d', 'failed', '', '', '', '0', '0.0', 'd.mcap: no such "recording", as it were']]
    assert ledger.status == 2
    ledger.tell()
    assert capsys.readouterr().out == f'2 done, 1 open, 1 failed, 1 not finished; {tmp_path}/summary.csv\n'
    assert [path.name for path in tmp_path.iterdir()] == ['summary.csv']


def test_a_summary_of_somebody_else_is_not_replaced(tmp_path, drives):
    summary = tmp_path / 'summary.csv'
    for content in (b'', b'name,what\n', b'\xff\xfe', b'name' * 10**6):
        summary.write_bytes(content)
        with pytest.raises(UsageError, match=r'summary.csv: is not of an earlier run'):
            Ledger(tmp_path, drives)
        assert summary.read_bytes() == content
    summary.unlink()
    summary.mkdir()
    with pytest.raises(UsageError, match='another --output'):
        Ledger(tmp_path, drives)
    summary.rmdir()
    Ledger(tmp_path, drives).add(outcome(next(iter(drives))))
    written = summary.read_text()
    summary.write_text(written.rstrip('\n') + ',9\n')
    with pytest.raises(UsageError, match=r'summary.csv: line 2 has 9 cells, not 8, and would be lost; mend it'):
        Ledger(tmp_path, drives)
    summary.unlink()
    Ledger(tmp_path, drives).add(outcome(next(iter(drives))))
    Ledger(tmp_path, drives)  # of an earlier run
    assert rows(summary) == []


def test_a_summary_that_can_no_longer_be_written_is_told_once_and_the_work_goes_on(tmp_path, drives, capsys):
    ledger = Ledger(tmp_path / 'out', drives)
    shutil.rmtree(tmp_path / 'out')
    (tmp_path / 'out').write_text('a file in its place')
    for path in drives:
        ledger.add(outcome(path))
    assert capsys.readouterr().err.count('summary.csv: cannot be written: ') == 1
    assert ledger.status == console.WRONG
    ledger.tell()
    assert capsys.readouterr().out.endswith('/out/summary.csv lacks the last rows: it could not be written\n')


def test_rows_of_other_recordings_stay_while_their_results_do(tmp_path, drives):
    a, b, c, d, _ = drives
    ledger = Ledger(tmp_path, drives)
    for path in (a, b, c):
        ledger.add(outcome(path, edges=4))
    for name in ('a', 'b', 'other'):
        (tmp_path / name).mkdir()
    later = Ledger(tmp_path, {b: 'b', d: 'd'})
    assert [(row['name'], row['edges']) for row in rows(tmp_path / 'summary.csv')] == [('a', '4'), ('b', '4')]
    later.add(outcome(d, 2, ''))
    later.add(outcome(b, edges=5))
    found = [(row['name'], row['status'], row['edges']) for row in rows(tmp_path / 'summary.csv')]
    assert found == [('b', 'done', '5'), ('d', 'failed', ''), ('a', 'done', '4')]
    assert later.status == 2


def test_a_name_takes_one_line_whatever_is_in_it(tmp_path, capsys):
    path = tmp_path / 'x\r\ny\x1b[31m\N{RIGHT-TO-LEFT OVERRIDE}.mcap'
    (tmp_path / path.stem).mkdir()
    Ledger(tmp_path, {path: path.stem}).add(outcome(path))
    for _ in range(2):  # and is found again
        (tmp_path / path.stem).mkdir(exist_ok=True)
        Ledger(tmp_path, {tmp_path / 'a.mcap': 'a'}).tell()
        assert [row['name'] for row in rows(tmp_path / 'summary.csv')] == [r'x\r\ny\x1b[31m\u202e']
        assert len((tmp_path / 'summary.csv').read_bytes().split(b'\n')) == 3
    capsys.readouterr()
    Ledger(tmp_path / 'a\nb', {}).tell()
    assert capsys.readouterr().out.count('\n') == 1


def test_no_name_is_a_formula(tmp_path):
    (tmp_path / '=1+1').mkdir()
    for _ in range(2):  # and is found again
        Ledger(tmp_path, {tmp_path / 'a.mcap': 'a'}).tell()
        Ledger(tmp_path, {tmp_path / '=1+1.mcap': '=1+1'}).add(outcome(tmp_path / '=1+1.mcap'))
        assert [row['name'] for row in rows(tmp_path / 'summary.csv')] == ['./=1+1']


def test_an_answer_that_was_there_when_it_was_interrupted_has_a_row(call, triangle, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr('polymap_ros.results.arrays.beam_map_npz', interrupted)
    other = tmp_path / 'other'
    other.symlink_to(triangle)
    done = call('replay', triangle, other, '--save-map', '--output', 'maps', *FAST)
    last = '1 done, 0 open, 0 failed, 1 not finished; maps/summary.csv'
    assert (done.status, done.out.splitlines()[-1]) == (130, last)
    row, = rows(tmp_path / 'maps' / 'summary.csv')
    assert (row['name'], row['status'], row['pings'], row['seconds']) == ('triangle', 'done', '60', '')
    assert row['error'] == 'interrupted: files beside polygon.json may be missing'


def test_a_name_that_is_no_utf_8(tmp_path):
    path = tmp_path / 'dr\udcffve.mcap'
    ledger = Ledger(tmp_path, {path: path.stem})
    ledger.add(outcome(path))
    assert rows(tmp_path / 'summary.csv')[0]['name'] == 'dr\\udcffve'


def test_a_recording_that_closes_one_that_does_not_and_one_that_fails(call, triangle, altered, tmp_path):
    def two_pings(topic, index, message):
        return [(topic, message)] if topic != '/echo' or index < 2 else []

    short = altered(two_pings, 'short')
    done = call('replay', short, triangle, 'none.mcap', '--output', 'maps', *FAST)
    assert done.status == 2
    assert done.out.splitlines()[-1] == '1 done, 1 open, 1 failed; maps/summary.csv'
    first, second, third = rows(tmp_path / 'maps' / 'summary.csv')
    assert [first[key] for key in ('name', 'status', 'warnings', 'pings')] == ['short', 'open', 'too_few_pings', '2']
    assert [second[key] for key in ('status', 'pings', 'error')] == ['done', '60', '']
    assert int(second['edges']) >= 3
    assert float(second['area']) > 0.0
    assert (third['status'], third['error']) == ('failed', 'none.mcap: no such recording')
    assert json.loads((tmp_path / 'maps' / 'short' / 'polygon.json').read_text())['recording'] == 'short'
    assert done.out.count('too_few') == 0  # stderr tells it
    assert done.err.count('go on pinging') == 1


def test_recordings_of_one_name_in_a_folder_are_named_with_an_output_each(call, triangle, tmp_path):
    for day in ('mon', 'tue'):
        shutil.copytree(triangle, tmp_path / 'drives' / day / 'run')
    complaint = call('replay', 'drives', '--output', 'maps', *FAST).complaint
    commands = complaint.partition('to replay all of them: ')[2].split('; ')
    assert commands == [f'polymap_replay drives/{day}/run --output maps/{day}/run' for day in ('mon', 'tue')]
    assert call(*shlex.split(commands[1].removeprefix('polymap_')), *FAST).status == 0
    assert (tmp_path / 'maps' / 'tue' / 'run' / 'polygon.json').is_file()


def test_a_folder_of_recordings_is_refused_with_what_replays_all_of_them(call, triangle, tmp_path):
    shutil.copytree(triangle, tmp_path / 'drives' / 'monday' / 'one')
    shutil.copy(triangle / 'triangle.mcap', tmp_path / 'drives' / "tuesday's.mcap")
    (tmp_path / 'drives' / 'notes.txt').write_text('no recording')
    done = call('replay', 'drives', '--output', 'maps', *FAST)
    assert (done.status, done.complaint) == (
        2, 'polymap_replay: error: drives: is no recording, but holds 2; to replay all of them: '
           """polymap_replay drives/monday/one 'drives/tuesday'"'"'s.mcap'""")
    assert 'drives/monday: is no recording, but holds 1; to replay it: polymap_replay drives/monday/one' in call(
        'replay', 'drives/monday', '--output', 'maps').complaint
    (tmp_path / 'drives' / 'monday' / 'one').rename(tmp_path / 'one')
    (tmp_path / 'drives' / "tuesday's.mcap").unlink()
    assert 'not a rosbag2 directory' in call('replay', 'drives', '--output', 'maps').complaint
    assert not (tmp_path / 'maps').exists()


def replay_that_loses(number, is_fault, begun):
    """A replay in which a signal comes, of which nothing is left, or a fault as numba makes of it."""
    def replay(path, folder, *rest):
        begun.append(path.name)
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt as stop:
            if is_fault:
                raise SystemError('returned a result with an exception set') from stop
        return Outcome(path, folder, 0, 'closed')
    return replay


@pytest.mark.parametrize('is_fault', [True, False])
@pytest.mark.parametrize(('number', 'status', 'word'), [
    (signal.SIGINT, 130, 'interrupted'), (signal.SIGTERM, 143, 'terminated'), (signal.SIGHUP, 129, 'hung up')])
def test_a_signal_ends_the_batch_whatever_becomes_of_what_it_raises(
        call, tmp_path, monkeypatch, number, status, word, is_fault):
    begun, before = [], (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM))
    monkeypatch.setattr(replaying, '_replay', replay_that_loses(number, is_fault, begun))
    done = call('replay', 'a.mcap', 'b.mcap', '--output', 'out')
    assert (done.status, done.complaint) == (status, f'polymap_replay: {word}')
    assert begun == ['a.mcap']
    assert rows(tmp_path / 'out' / 'summary.csv') == []
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
    assert console.attempt('polymap_replay', lambda: 0) == 0  # it is of the past


def test_a_signal_ends_a_process_of_many_whatever_becomes_of_what_it_raises(tmp_path, monkeypatch):
    monkeypatch.setattr(console, '_STOPS', [])
    monkeypatch.setattr(fleet.os, '_exit', sys.exit)
    monkeypatch.setattr(replaying, '_replay', replay_that_loses(signal.SIGTERM, True, []))
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGALRM)
    try:
        with pytest.raises(SystemExit) as ended:
            fleet._in_process(replaying.replayed, tmp_path / 'a.mcap', tmp_path / 'a', None, None)
    finally:
        signal.signal(signal.SIGTERM, before[0])
        signal.signal(signal.SIGALRM, before[1])
    assert ended.value.code == console.TERMINATED


def test_ctrl_c_in_code_from_text_has_its_status(tmp_path):
    """As dataclasses and Numba make it: Python takes a KeyboardInterrupt there for one that nobody catches."""
    (tmp_path / 'tool.py').write_text(
        'import signal, sys\nfrom polymap_ros.commands import console\n'
        "sys.exit(console.execute('polymap', lambda: exec('signal.raise_signal(signal.SIGINT)')))\n")
    done = subprocess.run([sys.executable, '-m', 'tool'], cwd=tmp_path, capture_output=True, text=True, timeout=60,
                          check=False)
    assert (done.returncode, done.stderr) == (130, 'polymap: interrupted\n')
