"""What is flagged, and how it is told."""

from polymap_ros.evaluation.doubt_experiment import DoubtExperiment, doubt_table, faults
from polymap_ros.evaluation.trials import KindTrial
from polymap_ros.parameters import Parameters


def cells(table):
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in table.splitlines()]


def entry(make_trial, kind, seed, **changes):
    return KindTrial(kind, make_trial(seed, scene=f'{kind}-4-{seed}', **changes))


def test_every_kind_has_every_seed_and_the_edges_go_round():
    experiment = DoubtExperiment(['straight', 'seam'], range(2, 8, 2), range(3, 5), ['evidence'], 0.0, Parameters())
    assert experiment.scenes() == [
        ('straight', 2, 3), ('straight', 4, 4), ('straight', 6, 3), ('seam', 2, 3), ('seam', 4, 4), ('seam', 6, 3)]


def test_a_straight_path_is_flagged():
    experiment = DoubtExperiment(['straight'], [2], [4], ['evidence'], 0.0, Parameters())
    found, = experiment.run_one('straight', 2, 4)
    assert (found.kind, found.trial.scene, found.trial.seed) == ('straight', 'straight-4-2', 2)
    assert found.trial.status in ('ambiguous', 'open')
    assert found.trial.flagged
    assert 'straight_path' in found.trial.cautions
    assert list(found.row())[:2] == ['kind', 'scene']


def test_the_table_tells_flagged_right_and_silently_wrong(make_trial):
    trials = [
        entry(make_trial, 'straight', 1), entry(make_trial, 'straight', 2, right=False),
        entry(make_trial, 'straight', 3, right=False, cautions=('weak_edge', 'unexplained')),
        entry(make_trial, 'straight', 4, right=False, status='open', cautions=('unexplained',)),
        entry(make_trial, 'ordinary', 1), entry(make_trial, 'ordinary', 2, cautions=('weak_edge',)),
    ]
    straight, ordinary = cells(doubt_table(trials))[2:]
    assert straight[2:] == ['4', 'yes', '50.0 %', '25.0 %', '25.0 %', 'closed 3, open 1', 'unexplained 2, weak_edge 1']
    assert ordinary[2:] == ['2', 'no', '50.0 %', '50.0 %', '0.0 %', 'closed 2', 'weak_edge 1']


def test_faults_are_what_should_be_flagged_and_is_not_and_ordinary_scenes_that_are(make_trial):
    trials = [
        entry(make_trial, 'straight', 1), entry(make_trial, 'straight', 2, cautions=('weak_edge',)),
        entry(make_trial, 'bent', 3), entry(make_trial, 'bent', 4, right=False),
        entry(make_trial, 'ordinary', 5), entry(make_trial, 'ordinary', 6, cautions=('weak_edge',)),
        entry(make_trial, 'ordinary', 7, right=False),
    ]
    assert faults(trials) == '- paper, straight: 4-1\n- paper, bent: 4-4\n- paper, ordinary: 4-6, 4-7'
    assert faults(trials[1:3]) == '- none'
