"""results.csv, and the rows that an interrupted run keeps."""

import csv
import io
import sys
from itertools import count

from polymap_ros.evaluation.rows import PartialRows, csv_text


def test_results_have_a_row_per_trial_and_empty_cells_for_what_is_not_known(make_trial):
    rows = list(csv.DictReader(io.StringIO(csv_text([
        make_trial(z_r=(0.5, -1.25), z_theta=(2.0, 0.0)),
        make_trial(seed=2, snr_db=None, right=False, status='open', estimated_edges=0, iou=0.0,
                   offsets_m=(), angles_deg=(), least_likelihood=None, cautions=('weak_edge', 'unexplained')),
    ]))))
    assert rows[0]['scene'] == 'convex-4-1'
    assert [rows[0][name] for name in ('seed', 'edges', 'estimated_edges', 'right', 'snr_db')] == [
        '1', '4', '4', '1', '0']
    assert [float(rows[0][name]) for name in (
        'median_offset_m', 'max_offset_m', 'median_angle_deg', 'max_angle_deg', 'iou', 'seconds')] == [
        0.002, 0.006, 0.2, 0.3, 0.99, 0.5]
    assert [rows[1][name] for name in ('right', 'status', 'snr_db', 'median_offset_m', 'max_angle_deg')] == [
        '0', 'open', '', '', '']
    assert [[row[name] for name in ('z_r', 'z_theta', 'least_likelihood', 'cautions')] for row in rows] == [
        ['0.500;-1.250', '2.000;0.000', '0.95', ''], ['', '', '', 'weak_edge;unexplained']]


def test_rows_are_on_the_disk_as_they_come(make_trial, tmp_path):
    first, second = [make_trial(1), make_trial(2)], [make_trial(3)]
    rows = PartialRows(tmp_path / 'out')
    rows.add([])
    assert not (tmp_path / 'out').exists()
    rows.add(first)
    assert rows.path.read_text() == csv_text(first)
    rows.add(second)
    assert rows.path.read_text() == csv_text(first + second)
    PartialRows(tmp_path / 'out').add(second)
    assert rows.path.read_text() == csv_text(second)
    rows.discard()
    rows.discard()
    assert list((tmp_path / 'out').iterdir()) == []


def test_wherever_it_is_interrupted_the_file_holds_whole_rows(make_trial, tmp_path):
    first, second = [make_trial(1)], [make_trial(2)]
    whole = [None, csv_text(first), csv_text(first + second)]
    seen = []
    for line in count():
        rows = PartialRows(tmp_path / str(line))
        if not _interrupted_at(line, rows, [first, second]):
            break
        text = rows.path.read_text() if rows.path.exists() else None
        assert text in whole
        seen.append(whole.index(text))
        assert {path.name for path in rows.path.parent.glob('*')} <= {rows.path.name}
    assert seen == sorted(seen)
    assert set(seen) == {0, 1, 2}


def _interrupted_at(line, rows, jobs):
    """Whether Ctrl-C at the given line of ours, counted as they are run, came before the end of the work."""
    left = line

    def traced(frame, event, argument):
        nonlocal left
        if not frame.f_code.co_filename.endswith('rows.py'):
            return None
        if event == 'line':
            left -= 1
            if left < 0:
                sys.settrace(None)
                raise KeyboardInterrupt
        return traced

    before = sys.gettrace()
    sys.settrace(traced)
    try:
        for results in jobs:
            rows.add(results)
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False
