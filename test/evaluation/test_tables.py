import pytest
from scipy.stats import binomtest

from polymap_ros.evaluation.tables import accuracy_table, failures, markdown, paper_table, random_table, wilson


def cells(table):
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in table.splitlines()]


def test_the_random_table_counts_scenes_by_method_and_edges(make_trial):
    trials = [
        make_trial(1, 3), make_trial(2, 3, right=False, estimated_edges=4, iou=0.5, offsets_m=(0.004,)),
        make_trial(1, 5, right=False, status='open', estimated_edges=0, iou=0.0, offsets_m=(), angles_deg=()),
        make_trial(1, 3, method='rectangle', right=False, seconds=0.25),
    ]
    header, _, *rows = cells(random_table(trials))
    column = {name: index for index, name in enumerate(header)}
    assert [row[:4] for row in rows] == [
        ['paper', '0', '3', '2'], ['paper', '0', '5', '1'], ['paper', '0', 'all', '3'], ['rectangle', '0', '3', '1']]
    assert [row[column['right']] for row in rows] == ['50.0 %', '0.0 %', '33.3 %', '0.0 %']
    assert [row[column['right number of edges']] for row in rows] == ['50.0 %', '0.0 %', '33.3 %', '100.0 %']
    assert [row[column['no polygon']] for row in rows] == ['0.0 %', '100.0 %', '33.3 %', '0.0 %']
    assert [row[column['flagged']] for row in rows] == ['0.0 %', '100.0 %', '33.3 %', '0.0 %']
    assert [row[column['silently wrong']] for row in rows] == ['50.0 %', '0.0 %', '33.3 %', '100.0 %']
    assert rows[3][column['median time [s]']] == '0.25'


def test_accuracy_is_that_of_the_walls_of_right_scenes_and_of_all(make_trial):
    trials = [
        make_trial(1, 3, z_r=(0.1, -2.5, 1.9, 0.0), z_theta=(-1.0, 2.0, 0.0, -0.2),
                   z_length=(0.0, 3.0), z_angle=(1.0, -1.0, 2.5), z_area=(-3.0,)),
        make_trial(2, 3, right=False, iou=0.5, offsets_m=(0.004,), angles_deg=(0.9,), z_r=(30.0,), z_theta=(9.0,),
                   certain_real=1, certain_edges=2),
        make_trial(1, 3, 'rectangle', right=False, offsets_m=(), angles_deg=(), certain_edges=0, certain_real=0),
    ]
    header, _, evidence, rectangle = cells(accuracy_table(trials))
    assert header[:4] == ['method', 'SNR [dB]', 'edges', 'median IoU']
    assert evidence[3:] == ['0.7450', '2.000', '0.200', '3.000', '0.250', '75.0 %', '100.0 %', '50.0 %', '66.7 %',
                            '0.0 %', '5', '80.0 %']
    assert rectangle[3:] == ['0.9900', *9 * ['-'], '0', '-']


def test_every_snr_has_its_own_rows(make_trial):
    trials = [make_trial(seed, snr_db=snr_db, right=snr_db != -20.0)
              for snr_db in (0.0, -20.0, None) for seed in (1, 2)]
    assert [(row[1], row[4]) for row in cells(random_table(trials))[2:]] == [
        ('0', '100.0 %'), ('-20', '0.0 %'), ('inf', '100.0 %')]
    assert failures(trials) == '- paper, -20 dB, 4 edges: 1, 2'


def test_failures_are_listed_by_seed_with_a_star_where_the_user_was_warned(make_trial):
    assert failures([make_trial()]) == '- none'
    trials = [make_trial(7, right=False), make_trial(8), make_trial(9, right=False, cautions=('weak_edge',)),
              make_trial(7, 3, 'rectangle', right=False)]
    assert failures(trials) == '- paper, 0 dB, 4 edges: 7, 9*\n- rectangle, 0 dB, 3 edges: 7'


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
