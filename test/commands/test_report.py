"""polymap_replay --report: a page beside the answer, the same each time; one that fails costs itself only."""

import errno
import json
import os
import re
import sys
from pathlib import Path

import pytest

from polymap_ros.commands import replay

pytest.importorskip('jinja2')

QUICK = '-p', 'solver.method:=paper', '-p', 'solver.iterations:=20'


def test_a_page_is_written_beside_the_answer_and_is_the_same_each_time(call, triangle, tmp_path):
    assert call('replay', triangle, *QUICK, '--report', '--output', 'a').status in (0, 1)
    assert call('replay', triangle, *QUICK, '--report', '--output', 'b/c').status in (0, 1)
    page = (tmp_path / 'a' / 'report.html').read_bytes()
    assert page == (tmp_path / 'b' / 'c' / 'report.html').read_bytes()
    answer = json.loads((tmp_path / 'a' / 'polygon.json').read_bytes())
    text = page.decode()
    assert '<h1><bdi>triangle</bdi></h1>' in text
    assert f'class="badge {answer["status"]}"' in text
    assert 'solver.iterations' in text
    assert str(tmp_path) not in text
    assert str(triangle.parent) not in text


def test_a_later_run_without_the_option_takes_the_page_away(call, triangle, tmp_path):
    call('replay', triangle, *QUICK, '--report', '--output', 'a')
    call('replay', triangle, *QUICK, '--output', 'a')
    assert (tmp_path / 'a' / 'polygon.json').exists()
    assert not (tmp_path / 'a' / 'report.html').exists()


def test_a_page_that_cannot_be_made_costs_itself_only(call, triangle, tmp_path, monkeypatch):
    def fail(*_):
        raise RuntimeError('no more ink')

    monkeypatch.setattr('polymap_ros.results.report.page.report_html', fail)
    done = call('replay', triangle, *QUICK, '--report', '--save-map', '--output', 'a')
    assert done.status == 2
    assert 'a/report.html: not written: ' in done.err
    assert 'no more ink' in done.err
    assert {'polygon.json', 'state.npz', 'beam_map.npz'} <= {path.name for path in (tmp_path / 'a').iterdir()}
    assert not (tmp_path / 'a' / 'report.html').exists()


def test_without_jinja_it_is_refused_before_the_work(call, triangle, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'jinja2', None)
    monkeypatch.setattr(replay, 'replayed', lambda *_: pytest.fail('began to work'))
    done = call('replay', triangle, '--report', '--output', 'a')
    assert done.status == 2
    assert done.complaint == "polymap_replay: error: --report needs Jinja2: pip install 'polymap_ros[report]'"
    assert not (tmp_path / 'a').exists()


def test_many_recordings_have_an_index_over_their_pages(call, triangle, tmp_path):
    (tmp_path / 'empty.mcap').write_bytes(b'')
    other = tmp_path / 'a & b'
    other.symlink_to(triangle)
    done = call('replay', triangle, other, tmp_path / 'empty.mcap', *QUICK, '--report', '--output', 'a')
    assert done.status == 2
    text = (tmp_path / 'a' / 'index.html').read_text()
    assert '<a href="./triangle/report.html"><bdi>triangle</bdi></a>' in text
    assert '<a href="./a%20%26%20b/report.html"><bdi>a &amp; b</bdi></a>' in text
    assert '<bdi>empty</bdi></th>' in text
    assert '1 failed.' in text
    assert str(tmp_path) not in text
    call('replay', triangle, other, *QUICK, '--output', 'a')  # and no --report: the pages go, and so does their index
    assert not (tmp_path / 'a' / 'index.html').exists()


def test_an_index_is_over_the_pages_of_earlier_runs_too(call, triangle, tmp_path):
    for name in ('b', 'c', 'd', 'e'):
        (tmp_path / name).symlink_to(triangle)

    def names():
        return re.findall(r'<bdi>(\w+)</bdi>(?:</a>)?</th>', (tmp_path / 'a' / 'index.html').read_text())

    call('replay', triangle, 'b', *QUICK, '--report', '--output', 'a')
    call('replay', 'c', 'b', *QUICK, '--report', '--output', 'a')
    assert names() == ['c', 'b', 'triangle']
    call('replay', 'd', 'e', *QUICK, '--output', 'a')  # and no --report: there is an index, which stays true
    assert names() == ['d', 'e', 'c', 'b', 'triangle']
    text = (tmp_path / 'a' / 'index.html').read_text()
    assert './triangle/report.html' in text
    assert './d/report.html' not in text


def test_an_index_that_is_not_ours_stays(call, triangle, tmp_path, monkeypatch):
    monkeypatch.setattr(replay, 'replayed', lambda *_: pytest.fail('began to work'))
    theirs = tmp_path / 'a' / 'index.html'
    theirs.parent.mkdir()
    theirs.write_text('<h1>My site</h1>')
    other = tmp_path / 'other'
    other.symlink_to(triangle)
    done = call('replay', triangle, other, '--report', '--output', 'a')
    assert (done.status, theirs.read_text()) == (2, '<h1>My site</h1>')
    assert not (tmp_path / 'a' / 'summary.csv').exists()
    assert 'a/index.html: is not of an earlier run' in done.complaint


def test_a_recording_that_is_called_like_the_index_is_refused_before_the_work(call, triangle, tmp_path, monkeypatch):
    monkeypatch.setattr(replay, 'replayed', lambda *_: pytest.fail('began to work'))
    (tmp_path / 'index.html').symlink_to(triangle)
    done = call('replay', triangle, 'index.html', '--report', '--output', 'a')
    assert (done.status, (tmp_path / 'a').exists()) == (2, False)
    assert done.complaint.startswith('polymap_replay: error: index.html: has no name that its folder in a could have')


def test_an_index_that_cannot_be_removed_is_told_before_the_work(call, triangle, tmp_path, monkeypatch):
    monkeypatch.setattr(replay, 'replayed', lambda *_: pytest.fail('began to work'))
    index = tmp_path / 'a' / 'index.html'
    index.parent.mkdir()
    index.write_text('<meta name="generator" content="polymap_ros">')
    unlink = Path.unlink

    def refuse(path, missing_ok=False):
        if path.name == index.name:
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM), str(path))
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, 'unlink', refuse)
    other = tmp_path / 'other'
    other.symlink_to(triangle)
    done = call('replay', triangle, other, '--output', 'a')
    assert (done.status, done.err.count('\n')) == (2, 1)
    assert done.complaint.startswith('polymap_replay: error: a/index.html: cannot be written: one of an earlier run')


def test_an_index_that_cannot_be_written_costs_itself_only(call, triangle, tmp_path, monkeypatch):
    def fail(_):
        raise RuntimeError('no more ink')

    monkeypatch.setattr('polymap_ros.results.report.index.index_html', fail)
    other = tmp_path / 'other'
    other.symlink_to(triangle)
    done = call('replay', triangle, other, *QUICK, '--report', '--output', 'a')
    assert done.status == 2
    assert 'a/index.html: not written: ' in done.err
    assert (tmp_path / 'a' / 'other' / 'report.html').exists()


def test_an_interruption_leaves_the_index_of_what_is_over(call, triangle, tmp_path, monkeypatch):
    other = tmp_path / 'other'
    other.symlink_to(triangle)
    first = replay.replayed

    def attempt(path, *rest):
        if path == other:
            raise KeyboardInterrupt
        return first(path, *rest)

    monkeypatch.setattr(replay, 'replayed', attempt)
    done = call('replay', triangle, other, *QUICK, '--report', '--output', 'a')
    assert done.status == 130
    text = (tmp_path / 'a' / 'index.html').read_text()
    assert '<bdi>triangle</bdi>' in text
    assert '<bdi>other</bdi>' not in text


def test_an_answer_of_an_earlier_run_is_not_in_the_index(tmp_path):
    from polymap_ros.commands.pages import write_index
    from polymap_ros.commands.replaying import Outcome

    (tmp_path / 'old').mkdir()
    (tmp_path / 'old' / 'polygon.json').write_text(
        '{"status": "closed", "area": 1.5, "pings": {"received": 9, "used": 9}, "edges": [], "vertices": []}')
    error = f'{tmp_path}/old: no space left'
    outcome = Outcome(tmp_path / 'old.mcap', tmp_path / 'old', 2, 'closed', (), 4, 1.25, None, 9, 9, 1.0, error)
    assert write_index(tmp_path, [('old', outcome)]) == ''
    text = (tmp_path / 'index.html').read_text()
    assert '1.5' not in text.split('<tbody')[1]
    assert 'old: no space left' in text
    assert str(tmp_path) not in text
