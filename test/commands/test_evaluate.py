"""polymap_evaluate as a user calls it, on a few scenes."""

import contextlib
import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from polymap_ros.commands.evaluate import main
from polymap_ros.commands.experiments import EXPERIMENTS, parser
from polymap_ros.simulation.shaped_scenes import ECHOES

DATA = Path(os.environ.get('POLYMAP_DATA') or Path(__file__).parents[2].parent / 'shared' / 'data')
DRIVE = DATA / 'odometry' / 'test2.bag'


def rows(path):
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def test_random_scenes_by_several_methods(tmp_path, capsys):
    assert main(['random', '--method', 'paper,rectangle', '--edges', '3-4', '--seeds', '4:8:2', '--snr-db', '-3',
                 '--output', str(tmp_path / 'out')]) == 0
    out, err = capsys.readouterr()
    results = rows(tmp_path / 'out' / 'results.csv')
    assert [(row['seed'], row['edges'], row['method']) for row in results] == [
        (seed, edges, method) for seed in '46' for edges in '34' for method in ('paper', 'rectangle')]
    assert {row['snr_db'] for row in results} == {'-3'}
    assert {row['status'] for row in results} == {'closed'}
    assert all(0.0 <= float(row['iou']) <= 1.0 and float(row['seconds']) > 0.0 for row in results)
    table = (tmp_path / 'out' / 'table.md').read_text()
    assert table in out
    assert '| paper | -3 | all | 4 |' in table
    assert 'theta within 2 sigma' in table
    assert 'Not right, by seed' in table
    assert (tmp_path / 'out' / 'success.png').stat().st_size > 5_000
    assert '4/4' in err
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == ['results.csv', 'success.png', 'table.md']


@pytest.mark.skipif(not DRIVE.exists(), reason=f'{DRIVE} is not there')
def test_paths_of_real_wheels(tmp_path):
    """Stretches of 84 m that a Jackal drove, in plates of their size."""
    convert = Path(sys.executable).with_name('rosbags-convert')
    subprocess.run([convert, '--src', DRIVE, '--dst', tmp_path / 'drive'], check=True, capture_output=True)
    scenes = ['random', '--method', 'evidence', '--edges', '3-8', '--seeds', '3:4']
    drive = ['--drive', str(tmp_path / 'drive'), '-p', 'topics.odom:=/jackal_velocity_controller/odom']
    assert main([*scenes, *drive, '--output', str(tmp_path / 'driven')]) == 0
    assert main([*scenes, '--output', str(tmp_path / 'random')]) == 0
    driven, random = (rows(tmp_path / name / 'results.csv') for name in ('driven', 'random'))
    assert [row['right'] for row in driven] == 6 * ['1']
    assert all(one['iou'] != other['iou'] for one, other in zip(driven, random, strict=True))


def test_the_same_run_gives_the_same_rows_in_one_process_and_in_two(tmp_path):
    for name, jobs in (('one', '1'), ('two', '2')):
        assert main(['random', '--edges', '3', '--seeds', '0:3', '--method', 'rectangle', '--jobs', jobs,
                     '--output', str(tmp_path / name)]) == 0
    one, two = ([{key: value for key, value in row.items() if key != 'seconds'}
                 for row in rows(tmp_path / name / 'results.csv')] for name in ('one', 'two'))
    assert one == two


def test_several_snrs_have_their_own_rows_and_a_second_picture(tmp_path, capsys):
    assert main(['random', '--method', 'rectangle', '--edges', '4', '--seeds', '4:6', '--snr-db', '0,-20,none',
                 '--output', str(tmp_path)]) == 0
    assert [(row['seed'], row['snr_db']) for row in rows(tmp_path / 'results.csv')] == [
        (seed, snr_db) for seed in '45' for snr_db in ('', '0', '-20')]
    table = (tmp_path / 'table.md').read_text()
    assert all(f'| rectangle | {snr_db} | 4 | 2 |' in table for snr_db in ('inf', '0', '-20'))


def test_estimates_after_every_ping(tmp_path, capsys):
    assert main(['online', '--method', 'rectangle', '--variant', 'pings_20', '--edges', '4', '--seeds', '4:6',
                 '--output', str(tmp_path)]) == 0
    results = rows(tmp_path / 'results.csv')
    assert [(row['seed'], row['pings'], len(row['right'])) for row in results] == [('4', '20', 20), ('5', '20', 20)]
    assert (tmp_path / 'table.md').read_text() in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ['online.png', 'results.csv', 'table.md']


def test_doubtful_scenes_of_one_kind(tmp_path, capsys):
    assert main(['doubt', '--variant', 'nearly_straight', '--method', 'rectangle', '--edges', '3-4', '--seeds', '2:4',
                 '--output', str(tmp_path)]) == 0
    assert [(row['kind'], row['seed'], row['edges'], row['status']) for row in rows(tmp_path / 'results.csv')] == [
        ('nearly_straight', '2', '3', 'ambiguous'), ('nearly_straight', '3', '4', 'ambiguous')]
    assert '| 2 | yes | 100.0 % |' in (tmp_path / 'table.md').read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ['results.csv', 'table.md']


def test_the_paper_s_experiment(tmp_path, capsys):
    assert main(['paper', '--repetitions', '2', '-p', 'solver.iterations:=60', '--output', str(tmp_path)]) == 0
    results = rows(tmp_path / 'results.csv')
    assert [(row['scene'], row['method'], row['run']) for row in results] == [
        *((scene, 'paper', run) for scene in ('triangle', 'quadrilateral', 'pentagon', 'rectangle') for run in '12'),
        ('rectangle', 'rectangle', '0')]
    out = capsys.readouterr().out
    assert '| triangle | paper | 2 |' in out
    assert '| rectangle | rectangle | 1 |' in out
    assert (tmp_path / 'fig3.png').stat().st_size > 20_000
    assert (tmp_path / 'fig4b.png').stat().st_size > 10_000


@pytest.mark.parametrize(('arguments', 'word'), [
    (['random', '--variant', 'wet'], 'air_chirp'),
    (['random', '--method', 'guess'], 'solver.method'),
    (['paper', '--method', 'guess'], 'solver.method'),
    (['random', '--repetitions', '3'], '--repetitions'),
    (['paper', '--seeds', '0:3'], '--seeds'),
    (['paper', '--snr-db', '0,-10'], '--snr-db'),
    (['online', '--snr-db', '0,-10'], '--snr-db'),
    (['online', '--repetitions', '3'], '--repetitions'),
    (['live', '--snr-db', '0'], '--snr-db does not act in "live", but in paper, random, online, doubt, calibration'),
    (['cpu', '--jobs', '2'], '--jobs'),
    (['speed', '--odom-hz', '2'], '--odom-hz'),
    (['live', '--drive', 'x'], '--drive'),
    (['doubt', '--variant', 'plate'], 'nearly_straight'),
    (['random', '--variant', 'needle', '--edges', '4', '--seeds', '0:1'], 'needle with 4 edges'),
])
def test_wrong_use_is_one_line_and_status_2(tmp_path, capsys, arguments, word):
    assert main([*arguments, '--output', str(tmp_path / 'out')]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert last.startswith('polymap_evaluate: error: ')
    assert word in last
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('arguments', [
    ['random'], ['everything', '--output', 'x'], ['random', '--output', 'x', '--edges', '2-4'],
    ['random', '--output', 'x', '--edges', '5-4'], ['random', '--output', 'x', '--seeds', '3'],
    ['random', '--output', 'x', '--seeds', '3:3'], ['random', '--output', 'x', '--seeds', '0:9:0'],
    ['random', '--output', 'x', '--seeds', f'0:{10**22}'],
    ['random', '--output', 'x', '--seeds', f'{10**22}:{10**22 + 1}'],
    ['random', '--output', 'x', '--seeds', '0:2000000'],
    ['random', '--output', 'x', '--jobs', '0'], ['random', '--output', 'x', '--snr-db', 'loud'],
    ['random', '--output', 'x', '--snr-db', 'nan'],
])
def test_arguments_that_mean_nothing_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1
    assert ' _' not in complaint  # no name of a function


def test_the_wave_equation_with_inner_walls_is_refused_before_the_work(tmp_path, capsys):
    """And what may be asked for is what a scene's echoes may be."""
    assert main(['shapes', '--echoes', 'waves', '--output', str(tmp_path / 'waves')]) == 2
    assert 'which stiffener, seam have; name another --variant' in capsys.readouterr().err
    assert main(['shapes', '--echoes', 'fresnel', '--output', str(tmp_path / 'fresnel')]) == 2
    assert 'not of round holes, which round_hole, two_round_holes have' in capsys.readouterr().err
    assert main(['shapes', '--variant', 'l', '--echoes', 'waves', '--world', 'mild', '--output', str(tmp_path)]) == 2
    assert 'of --world mild echoes are images' in capsys.readouterr().err
    assert main(['shapes', '--world', 'mild', '--output', str(tmp_path / 'mild')]) == 2
    assert 'round_hole, two_round_holes have something' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(SystemExit):
        main(['shapes', '--echoes', 'ideal', '--output', 'x'])
    complaint = capsys.readouterr().err
    assert all(echoes in complaint for echoes in ECHOES)


@pytest.mark.parametrize('experiment', EXPERIMENTS)
def test_the_help_of_an_experiment_tells_what_acts_in_it_and_how_long_it_takes(experiment, capsys):
    with pytest.raises(SystemExit) as caught:
        main([experiment, '--help'])
    assert caught.value.code == 0
    told = capsys.readouterr().out
    assert f'\n  polymap_evaluate {experiment} --' in told
    assert 'Writes results.csv' in ' '.join(told.split())
    assert '\nTime: ' in told
    for option in ('--seeds', '--repetitions', '--growth', '--ping-hz'):
        if option not in told:
            assert main([experiment, option, '0:1' if option == '--seeds' else '1', '--output', 'x']) == 2
            assert f'{option} does not act in "{experiment}"' in capsys.readouterr().err


@pytest.mark.parametrize('experiment', EXPERIMENTS)
def test_examples_of_the_help_are_read(experiment):
    for example in EXPERIMENTS[experiment].examples:
        assert parser(experiment).parse_args(example.split()).experiment == experiment


def test_arguments_are_read_as_ranges():
    arguments = parser().parse_args(
        ['random', '--output', 'x', '--edges', '3-8', '--seeds', '10:20:3', '--snr-db', 'none'])
    assert list(arguments.edges) == [3, 4, 5, 6, 7, 8]
    assert list(arguments.seeds) == [10, 13, 16, 19]
    assert arguments.snr_db == [None]
    assert parser().parse_args(['random', '--output', 'x', '--snr-db', '0,-10,none']).snr_db == [0.0, -10.0, None]


def test_interrupted_is_status_130_and_the_rows_so_far_are_kept(tmp_path):
    command = [sys.executable, '-c', 'import sys; from polymap_ros.commands.evaluate import main; sys.exit(main())',
               'random', '--seeds', '0:1000', '--edges', '3', '--jobs', '2', '--method', 'rectangle', '--output',
               str(tmp_path)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        deadline = time.monotonic() + 60.0
        partial = tmp_path / 'results.partial.csv'
        while not partial.exists() and time.monotonic() < deadline:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(0.05)
                break
        os.killpg(process.pid, signal.SIGINT)
        _, rest = process.communicate(timeout=60.0)
    finally:
        if process.poll() is None:
            process.kill()
    assert process.returncode == 130
    assert rest.strip().splitlines()[-1] == 'polymap_evaluate: interrupted'
    assert 'Traceback' not in rest
    assert [path.name for path in tmp_path.iterdir()] == ['results.partial.csv']
    assert {row['edges'] for row in rows(partial)} == {'3'}


@pytest.mark.parametrize('name', ['table.md', 'success.png', 'results.partial.csv'])
def test_results_take_the_place_of_nothing_that_is_not_of_an_earlier_run(tmp_path, capsys, name):
    (tmp_path / name).write_text('mine')
    assert main(['random', '--edges', '3', '--seeds', '0:1', '--method', 'rectangle', '--output', str(tmp_path)]) == 2
    assert capsys.readouterr().err.count(name) == 1
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, 'mine')]


@pytest.mark.parametrize(('folder', 'cause'), [
    ('file', 'file: cannot be written: it is a file'), ('file/out', 'file/out: cannot be written: file is a file'),
    ('astray', 'astray: cannot be written: astray is a link to nowhere'),
    ('/proc/out', '/proc/out: cannot be written: '),
    ('taken', 'taken/table.md: cannot be written: it is a folder')])
def test_what_cannot_be_written_is_told_before_the_work(tmp_path, monkeypatch, capsys, folder, cause):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').touch()
    (tmp_path / 'astray').symlink_to('nowhere')
    (tmp_path / 'taken' / 'table.md').mkdir(parents=True)
    before = sorted(tmp_path.rglob('*'))
    assert main(['random', '--edges', '3', '--seeds', '0:1', '--method', 'rectangle', '--output', folder]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count('\n')) == ('', 1)  # no progress either
    assert f'polymap_evaluate: error: {cause}' in err
    assert sorted(tmp_path.rglob('*')) == before


def test_of_an_earlier_run_nothing_is_left_beside_the_results(tmp_path):
    scene = ['--edges', '3', '--seeds', '0:1', '--method', 'rectangle', '--output', str(tmp_path)]
    assert main(['random', *scene]) == 0
    (tmp_path / 'notes.txt').write_text('mine')
    assert main(['doubt', '--variant', 'nearly_straight', *scene]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {'results.csv', 'table.md', 'notes.txt'}


def test_help_does_not_load_what_it_does_not_need():
    code = ('import sys, polymap_ros.commands.evaluate as e; e.parser(); '
            'print(sorted({"numpy", "numba", "scipy", "matplotlib", "tqdm"} & set(sys.modules)))')
    assert subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True).stdout == '[]\n'
