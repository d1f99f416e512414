import csv
import io

import pytest
from scipy.stats import binomtest

from polymap_ros.evaluation.tables import csv_text, failures, markdown, paper_table, random_table, wilson


def cells(table):
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in table.splitlines()]


def test_results_have_a_row_per_trial_and_empty_cells_for_what_is_not_known(make_trial):
    rows = list(csv.DictReader(io.StringIO(csv_text([
        make_trial(), make_trial(seed=2, snr_db=None, right=False, status='open', estimated_edges=0, iou=0.0,
                                 offsets_m=(), angles_deg=()),
    ]))))
    assert rows[0]['scene'] == 'convex-4-1'
    assert [rows[0][name] for name in ('seed', 'edges', 'estimated_edges', 'right', 'snr_db')] == [
        '1', '4', '4', '1', '0']
    assert [float(rows[0][name]) for name in (
        'median_offset_m', 'max_offset_m', 'median_angle_deg', 'max_angle_deg', 'iou', 'seconds')] == [
        0.002, 0.006, 0.2, 0.3, 0.99, 0.5]
    assert [rows[1][name] for name in ('right', 'status', 'snr_db', 'median_offset_m', 'max_angle_deg')] == [
        '0', 'open', '', '', '']


def test_the_random_table_counts_scenes_by_method_and_edges(make_trial):
    trials = [
        make_trial(1, 3), make_trial(2, 3, right=False, estimated_edges=4, iou=0.5, offsets_m=(0.004,)),
        make_trial(1, 5, right=False, status='open', estimated_edges=0, iou=0.0, offsets_m=(), angles_deg=()),
        make_trial(1, 3, method='rectangle', right=False, seconds=0.25),
    ]
    header, _, *rows = cells(random_table(trials))
    column = {name: index for index, name in enumerate(header)}
    assert [row[:3] for row in rows] == [
        ['paper', '3', '2'], ['paper', '5', '1'], ['paper', 'all', '3'], ['rectangle', '3', '1']]
    assert [row[column['right']] for row in rows] == ['50.0 %', '0.0 %', '33.3 %', '0.0 %']
    assert [row[column['right number of edges']] for row in rows] == ['50.0 %', '0.0 %', '33.3 %', '100.0 %']
    assert [row[column['no polygon']] for row in rows] == ['0.0 %', '100.0 %', '33.3 %', '0.0 %']
    assert [row[column['median IoU']] for row in rows] == ['0.7450', '0.0000', '0.5000', '0.9900']
    assert [row[column['median offset error [mm]']] for row in rows] == ['3.000', '-', '3.000', '2.000']
    assert rows[3][column['median time [s]']] == '0.25'


def test_failures_are_listed_by_seed(make_trial):
    assert failures([make_trial()]) == '- none'
    trials = [make_trial(7, right=False), make_trial(8), make_trial(9, right=False),
              make_trial(7, 3, 'rectangle', right=False)]
    assert failures(trials) == '- paper, 4 edges: 7, 9\n- rectangle, 3 edges: 7'


def test_the_paper_s_table_has_a_row_per_scene_and_method(make_trial):
    trials = [make_trial(scene='triangle', run=1, iou=0.9),
              make_trial(scene='triangle', run=2, estimated_edges=5, iou=0.7),
              make_trial(scene='rectangle', method='rectangle', seconds=0.1)]
    rows = cells(paper_table(trials))[2:]
    assert rows == [['triangle', 'paper', '2', '50.0 %', '100.0 %', '0.8000', '0.7000', '0.50'],
                    ['rectangle', 'rectangle', '1', '100.0 %', '100.0 %', '0.9900', '0.9900', '0.10']]


@pytest.mark.parametrize(('successes', 'of'), [(0, 10), (7, 10), (10, 10), (990, 1000)])
def test_the_interval_is_wilson_s(successes, of):
    expected = binomtest(successes, of).proportion_ci(method='wilson')
    assert wilson(successes, of) == pytest.approx((expected.low, expected.high), abs=1e-6)


def test_markdown_rows_have_the_header_s_cells():
    assert markdown(['a', 'b'], [['1', '2']]) == '| a | b |\n| --- | --- |\n| 1 | 2 |'
