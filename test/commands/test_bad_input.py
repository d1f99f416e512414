"""Bad input: the message, the drop reason and the status that the contract promises, and nothing partial written."""

import dataclasses
import importlib
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from damage import raw_messages, write_mcap

from polymap_ros.commands import console
from polymap_ros.recordings.writing import make

FAST = ('-p', 'solver.method:=paper', '-p', 'solver.iterations:=60')
ODOMETRY, SCAN = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan'
N_PINGS = 60


def refused(run, tmp_path, *arguments):
    """The complaint of a run that ends with status 2 and leaves no trace."""
    before = {path.name for path in tmp_path.iterdir()}
    done = run('replay', *FAST, *arguments, '--output', 'out')
    assert done.status == 2, done.err
    assert done.out == ''
    assert {path.name for path in tmp_path.iterdir()} == before
    return done.complaint.removeprefix('polymap_replay: error: ')


def pings(run, tmp_path, recording, *arguments, status=0):
    """What became of the pings of a run."""
    done = run('replay', recording, '--output', 'out', *arguments)
    assert done.status == status, done.err
    found = json.loads((tmp_path / 'out' / 'polygon.json').read_text())
    counts = found['pings']
    assert counts['received'] == counts['used'] + sum(counts['dropped'].values())
    for reason, number in counts['dropped'].items():
        assert f'{number} {reason}' in done.out
    return counts, found, done


def only(topic_to_change, change):
    """Change one message after the other of a topic; None leaves it out."""
    def rewrite(topic, index, message):
        changed = change(index, message) if topic == topic_to_change else message
        return [] if changed is None else [(topic, changed)]
    return rewrite


# What cannot be read

def test_a_missing_recording(run, tmp_path):
    assert refused(run, tmp_path, 'none') == 'none: no such recording'


@pytest.mark.parametrize('name', ['broken.mcap', 'broken.db3', 'broken.txt'])
def test_an_unreadable_recording(call, tmp_path, name):
    (tmp_path / name).write_bytes(b'not a recording at all')
    complaint = refused(call, tmp_path, name)
    assert complaint.startswith(f'{name}: ')
    assert 'cannot be read' in complaint


def test_a_folder_that_is_no_recording(call, tmp_path):
    (tmp_path / 'photos').mkdir()
    assert 'photos: holds no metadata.yaml' in refused(call, tmp_path, 'photos')


def test_a_recording_that_was_cut_off_before_its_first_chunk_was_written(call, triangle, tmp_path):
    whole = (triangle / 'triangle.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(whole[:len(whole) // 2])
    complaint = refused(call, tmp_path, 'cut.mcap')
    assert complaint.startswith('cut.mcap: cannot be read: cut.mcap has no end: it was cut off, or is still being')
    assert complaint.endswith('and no message can be rescued')
    folder = shutil.copytree(triangle, tmp_path / 'drive')
    (folder / 'triangle.mcap').write_bytes(b'else')
    assert refused(call, tmp_path, 'drive').endswith(
        "drive/triangle.mcap: cannot be read: is neither MCAP nor SQLite: it begins with 'else'")


def test_what_is_left_of_a_recording_is_mapped_with_a_warning(call, triangle, tmp_path):
    whole = (triangle / 'triangle.mcap').read_bytes()
    folder = shutil.copytree(triangle, tmp_path / 'drive')
    (folder / 'triangle.mcap').write_bytes(whole[:-20])
    counts, found, done = pings(call, tmp_path, 'drive')
    assert counts['used'] == N_PINGS
    (warning,) = found['warnings']
    assert warning['code'] == 'recording_damaged'
    assert done.complaint == f'polymap_replay: warning: drive: {warning["text"]}'
    assert warning['text'].startswith('triangle.mcap has no end: it was cut off, or is still being written')


def test_a_truth_that_is_none(call, altered, tmp_path):
    path = altered(lambda topic, index, message: [(topic, message)])
    (path / 'truth.json').write_text('{"vertices": "triangle"}')
    (path / 'truth.tum').write_text('1 2 3')
    done = call('replay', *FAST, path, '--output', 'out')
    told = [line for line in done.err.splitlines() if 'the map is not compared with it' in line]
    assert ['truth.json: is no ground truth' in told[0], 'truth.tum: ' in told[1], len(told)] == [True, True, 2]
    assert 'against the truth' not in done.out
    assert (tmp_path / 'out' / 'polygon.json').exists()


def test_a_true_hole_that_is_not_found_is_told(call, triangle, tmp_path):
    path = shutil.copytree(triangle, tmp_path / 'drive')
    truth = json.loads((path / 'truth.json').read_text())
    truth['holes'] = [{'vertices': [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]]}]
    (path / 'truth.json').write_text(json.dumps(truth))
    done = call('replay', *FAST, path, '--output', 'out')
    assert '  holes: 0 found, 0 of 1 right' in done.out
    truth['holes'] = 3
    (path / 'truth.json').write_text(json.dumps(truth))
    done = call('replay', *FAST, path, '--output', 'out')
    assert 'lists of holes and of inner_walls; the map is not compared' in done.err
    assert 'against the truth: ' in done.out


def test_a_recording_of_which_every_chunk_is_damaged_is_told_as_that(call, triangle, tmp_path):
    file = write_mcap(tmp_path / 'other.mcap', raw_messages(triangle), crcs=False)
    content = file.read_bytes()
    assert b'\x04\x00\x00\x00zstd' in content
    file.write_bytes(content.replace(b'\x04\x00\x00\x00zstd', b'\x04\x00\x00\x00brot'))
    told = refused(call, tmp_path, 'other.mcap')
    assert told.startswith('other.mcap: no message of /odom can be read: other.mcap: the chunk at byte ')
    assert '--start' not in told


def test_results_given_as_a_recording_are_called_so(call, tmp_path):
    (tmp_path / 'results').mkdir()
    (tmp_path / 'results' / 'polygon.json').write_text('{}')
    assert 'it holds results of polymap_ros (polygon.json), not a recording' in refused(call, tmp_path, 'results')


def test_echoes_of_another_type_that_is_known_are_told_with_the_parameter(call, altered, tmp_path):
    image = make('sensor_msgs/msg/Image')
    path = altered(only('/echo', lambda index, message: image))
    assert 'if these are the echoes, -p echo.type:=sensor_msgs/msg/Image; ' in refused(call, tmp_path, path)
    assert 'did you mean sensor_msgs/msg/PointCloud2?' in refused(
        call, tmp_path, path, '-p', 'echo.type:=sensor_msgs/msg/PointClod2')


def test_files_that_are_not_of_an_earlier_run_are_not_replaced(call, triangle, tmp_path):
    folder = tmp_path / 'site'
    folder.mkdir()
    for name in ('map.yaml', 'calibration.yaml'):
        (folder / name).write_text('mine')
    done = call('replay', *FAST, triangle, '--output', 'site')
    assert done.status == 2
    assert 'site: holds map.yaml, calibration.yaml and no polygon.json' in done.complaint
    assert {path.name: path.read_text() for path in folder.iterdir()} == {
        'map.yaml': 'mine', 'calibration.yaml': 'mine'}


@pytest.mark.parametrize('folder', ['loop', 'loop/within'])
def test_links_that_lead_to_themselves_hold_no_results(call, triangle, tmp_path, folder):
    (tmp_path / 'loop').symlink_to('loop')
    done = call('replay', *FAST, triangle, '--output', folder)
    assert done.status == 2
    assert done.complaint.startswith(f'polymap_replay: error: {folder}: ')
    assert 'such recording' in call('replay', 'loop').complaint
    assert call('simulate', 'triangle', '--output', 'loop').complaint.startswith('polymap_simulate: error: loop: ')


def test_a_frame_that_would_forge_lines_or_colours_does_not(altered, tmp_path):
    """And one that the terminal has no letters for is told all the same."""
    def renamed(topic, index, message):
        if topic == '/odom':
            message.header.frame_id = 'od\x1b[31m\nclosed: 3 edges \u00e4'
        return [(topic, message)]

    path = altered(renamed)
    code = f'import sys; from polymap_ros.commands.replay import main; sys.exit(main([{str(path)!r}, *{FAST!r}]))'
    done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, capture_output=True, timeout=300, check=False,
                          env=os.environ | {'PYTHONIOENCODING': 'ascii'})
    assert done.returncode == 0, done.stderr
    assert b'\x1b' not in done.stdout
    assert done.stdout.count(b'\nclosed: ') == 0  # but for the first line
    assert b'\\xe4' in done.stdout


# Topics

def test_a_missing_echo_topic_names_the_candidates(run, altered, tmp_path):
    names = {'/odom': '/odom', '/echo': '/sonar'}
    path = altered(lambda topic, index, message: [(names[topic], message)])
    assert refused(run, tmp_path, path) == (
        f'{path}: no topic /echo; topics of type {SCAN}: /sonar (choose with -p topics.echo:=/sonar)')
    assert pings(run, tmp_path, path, *FAST, '-p', 'topics.echo:=/sonar')[0]['used'] == N_PINGS


def test_no_odometry_at_all(call, altered, tmp_path):
    path = altered(only('/odom', lambda index, message: None))
    assert refused(call, tmp_path, path) == (
        f'{path}: no topic /odom; no other topic is of type {ODOMETRY}; recorded: /echo ({SCAN})')


def test_an_empty_echo_topic(call, triangle, altered, tmp_path):
    path = altered(only('/echo', lambda index, message: None if index else message))
    assert 'no message of /echo between --start and --end; the recording is' in refused(
        call, tmp_path, path, '--start', '20')


def test_odometry_of_the_wrong_type(call, altered, tmp_path):
    pose = make('geometry_msgs/msg/PoseStamped')
    path = altered(only('/odom', lambda index, message: pose))
    assert f'topic /odom is of type geometry_msgs/msg/PoseStamped, not {ODOMETRY}' in refused(call, tmp_path, path)


def test_echoes_of_the_wrong_type(call, triangle, tmp_path):
    cloud = 'sensor_msgs/msg/PointCloud2'
    assert f'topic /echo is of type {SCAN}, not {cloud}' in refused(
        call, tmp_path, triangle, '-p', f'echo.type:={cloud}')


def test_odometry_without_a_finite_pose(call, altered, tmp_path):
    def spoil(index, message):
        message.pose.pose.position.x = np.nan
        return message

    path = altered(only('/odom', spoil))
    assert 'messages of /odom can be used' in refused(call, tmp_path, path)


# Single bad messages are dropped and counted

def changed_samples(make_samples):
    def change(message):
        return dataclasses.replace(message, intensities=make_samples(np.array(message.intensities)))
    return change


def with_value(value):
    def change(samples):
        samples[100] = value
        return samples
    return changed_samples(change)


SPOILT = {
    'nan': (with_value(np.nan), 'bad_samples'),
    'infinite': (with_value(np.inf), 'bad_samples'),
    'silent': (changed_samples(np.zeros_like), 'bad_samples'),
    'empty': (changed_samples(lambda samples: samples[:0]), 'bad_shape'),
    'three_samples': (changed_samples(lambda samples: samples[:3]), 'too_short'),
    'lidar': (lambda message: dataclasses.replace(message, ranges=np.ones(10, np.float32)), 'wrong_type'),
    'period_zero': (lambda message: dataclasses.replace(message, time_increment=0.0), 'bad_shape'),
    'period_nan': (lambda message: dataclasses.replace(message, time_increment=np.nan), 'bad_shape'),
}


@pytest.mark.parametrize('fault', SPOILT)
def test_a_bad_ping_is_dropped_and_counted(call, altered, tmp_path, fault):
    change, reason = SPOILT[fault]
    path = altered(only('/echo', lambda index, message: change(message) if index in (7, 30) else message))
    counts, _, _ = pings(call, tmp_path, path, *FAST)
    assert counts == {'received': N_PINGS, 'used': N_PINGS - 2, 'dropped': {reason: 2}}


def test_a_period_that_contradicts_the_parameter(call, altered, tmp_path):
    path = altered(only('/echo', lambda index, message: dataclasses.replace(message, time_increment=2e-6)
                        if index == 5 else message))
    counts, _, _ = pings(call, tmp_path, path, *FAST, '-p', 'echo.sample_period_s:=1.0e-6')
    assert counts['dropped'] == {'bad_shape': 1}


@pytest.mark.parametrize('factor', [0.25, 0.5, 2.0])
def test_a_period_that_is_off_by_a_factor_is_the_only_cause_told_and_costs_no_search(call, altered, tmp_path, factor):
    path = altered(only('/echo', lambda index, message: dataclasses.replace(
        message, time_increment=factor * message.time_increment)))
    counts, found, done = pings(call, tmp_path, path, status=1)
    assert counts['used'] == N_PINGS
    assert [each['code'] for each in found['warnings']] == ['echo_band']
    assert found['walls'] == []  # which are elsewhere
    assert 'checking medium and odometry' not in done.err
    assert f'times too {"long" if factor > 1.0 else "short"}' in done.complaint


@pytest.mark.parametrize('per_metre', [pytest.param(100.0, marks=pytest.mark.heavy), 1000.0])
def test_odometry_in_another_unit_is_told_and_costs_no_search(call, altered, tmp_path, per_metre):
    def enlarge(index, message):
        position = message.pose.pose.position
        position.x, position.y = per_metre * position.x, per_metre * position.y
        return message

    counts, found, done = pings(call, tmp_path, altered(only('/odom', enlarge)), status=1)
    assert counts['used'] == N_PINGS
    assert [each['code'] for each in found['warnings']] == ['pings_far_apart']
    assert 'checking medium and odometry' not in done.err
    assert 'check that the odometry is in metres' in done.complaint


def test_pings_outside_the_odometry(call, altered, tmp_path):
    path = altered(only('/odom', lambda index, message: message if 100 < index < 300 else None))
    counts, _, _ = pings(call, tmp_path, path, *FAST)
    assert counts['received'] == N_PINGS
    assert counts['dropped'].keys() == {'no_pose'}
    assert counts['used'] > 0


def test_a_gap_in_the_odometry(call, altered, tmp_path):
    path = altered(only('/odom', lambda index, message: None if 100 < index < 160 else message))
    counts, _, _ = pings(call, tmp_path, path, *FAST)
    assert counts['dropped'].keys() == {'pose_gap'}


def test_stamps_out_of_order(call, altered, tmp_path):
    """Odometry that goes back is not taken and said so; the pings do not suffer."""
    def swap(index, message):
        stamp = message.header.stamp
        return dataclasses.replace(message, header=dataclasses.replace(
            message.header, stamp=dataclasses.replace(stamp, sec=stamp.sec - 5))) if index in (150, 151) else message

    path = altered(only('/odom', swap))
    counts, found, done = pings(call, tmp_path, path, *FAST)
    assert counts['used'] == N_PINGS
    (warning,) = found['warnings']
    assert warning['code'] == 'odometry_dropped'
    assert warning['text'].startswith('/odom: of 245 messages dropped: 2 out_of_order; ')
    assert warning['text'] in done.out


def test_a_ping_that_comes_twice(call, altered, tmp_path):
    def twice(topic, index, message):
        return [(topic, message)] * (2 if topic == '/echo' and index == 9 else 1)

    counts, _, _ = pings(call, tmp_path, altered(twice), *FAST)
    assert counts == {'received': N_PINGS + 1, 'used': N_PINGS, 'dropped': {'duplicate': 1}}


def test_a_fault_of_ours_is_one_line_in_every_command(capsys):
    assert console.execute('polymap_play', lambda: [][1]) == console.WRONG
    assert capsys.readouterr().err.startswith('polymap_play: error: IndexError: list index out of range (')


# Readable, but no polygon

def test_every_ping_dropped(call, altered, tmp_path):
    path = altered(only('/echo', lambda index, message: SPOILT['lidar'][0](message)))
    counts, found, done = pings(call, tmp_path, path, *FAST, '--save-map', status=1)
    assert counts == {'received': N_PINGS, 'used': 0, 'dropped': {'wrong_type': N_PINGS}}
    assert (found['status'], found['vertices'], found['edges']) == ('open', [], [])
    assert [each['code'] for each in found['warnings']] == ['pings_dropped']
    assert 'all pings were dropped, most as wrong_type: echo has 10 ranges: that is a lidar scan' in done.complaint
    assert "go on pinging" not in done.err + done.out
    assert (tmp_path / 'out' / 'beam_map.npz').exists()
    assert not (tmp_path / 'out' / 'map.pgm').exists()


def test_too_few_pings(run, altered, tmp_path):
    path = altered(only('/echo', lambda index, message: message if index < 2 else None))
    counts, found, done = pings(run, tmp_path, path, *FAST, status=1)
    assert counts['used'] == 2
    assert (found['status'], [each['code'] for each in found['warnings']]) == ('open', ['too_few_pings'])
    assert 'no polygon closes: 2 pings could be used, and a polygon takes at least 3; ' in done.complaint


@pytest.mark.parametrize('method', ['evidence', 'paper', 'rectangle'])
def test_all_pings_on_one_straight_line(call, altered, tmp_path, method):
    """The robot stands at a wall's distance on y = 0.3: mirror images cannot be told apart."""
    def straighten(index, message):
        message.pose.pose.position.y = 0.3
        message.pose.pose.position.x = 0.4 + 0.0003 * index
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = 0.0, 1.0
        return message

    path = altered(only('/odom', straighten))
    counts, found, done = pings(call, tmp_path, path, *FAST, '-p', f'solver.method:={method}', status=1)
    assert counts['used'] == N_PINGS
    assert found['status'] in ('open', 'ambiguous')
    assert (found['vertices'], found['edges']) == ([], [])
    assert found['warnings'][0]['code'] == 'straight_path'
    assert 'no polygon closes: ' in done.complaint
    assert 'mirror images' in done.complaint
    assert 'drive a turn' in done.complaint


# Parameters and usage

@pytest.mark.parametrize(('override', 'text'), [
    ('grid.range_stp_m:=0.01', 'parameter grid.range_stp_m: unknown; did you mean grid.range_step_m?'),
    ('grid.range_step_m:=-1', 'parameter grid.range_step_m: -1.0 is out of range; allowed: double in [1e-06, 10000] m'),
    ('grid.range_step_m:=.nan',
     'parameter grid.range_step_m: nan is out of range; allowed: double in [1e-06, 10000] m'),
    ('solver.max_edges:=2.5', 'parameter solver.max_edges: 2.5 is of type float; allowed: integer in [3, 64]'),
    ('solver.method:=magic', "parameter solver.method: 'magic' is not known; allowed: "),
    ('solver.seed', 'parameter solver.seed: expected name:=value'),
    ('solver.seed=3', 'parameter solver.seed=3: expected name:=value; did you mean solver.seed:=3?'),
    ('solver.seed: 3', 'parameter solver.seed: 3: expected name:=value; did you mean solver.seed:=3?'),
    ('solver.seed:=[', "parameter solver.seed: '[' is not a YAML value"),
])
def test_a_wrong_parameter(call, triangle, tmp_path, override, text):
    assert refused(call, tmp_path, triangle, '-p', override).startswith(text)


@pytest.mark.parametrize(('content', 'text'), [
    (None, 'cannot be read: No such file or directory'),
    ('a: [', 'is not YAML'),
    ('[1, 2]', 'is not a ROS parameter file'),
    ('other_node: {ros__parameters: {}}', 'has no polymap_node or /** key, only other_node'),
    ('polymap_node: {ros__parameters: {grid: {rnge: 1.0}}}', 'parameter grid.rnge: unknown'),
    ('polymap_node: {ros__parameters: {pulse: {kind: file, path: p.npy}}}', 'parameter pulse.path: '),
])
def test_a_wrong_parameter_file(run, triangle, tmp_path, content, text):
    if content is not None:
        (tmp_path / 'p.yaml').write_text(content)
    assert text in refused(run, tmp_path, triangle, '--params-file', 'p.yaml')


@pytest.mark.parametrize('span', [('--start', '-1'), ('--start', '5', '--end', '5'), ('--end', '0'),
                                  ('--start', 'nan'), ('--end', 'nan')])
def test_a_span_that_is_none(call, triangle, tmp_path, span):
    assert 'allowed: 0 <= start < end' in refused(call, tmp_path, triangle, *span)


def test_a_span_beyond_the_recording(call, triangle, tmp_path):
    complaint = refused(call, tmp_path, triangle, '--start', '1e30')
    assert 'no message of /odom between --start and --end' in complaint


@pytest.mark.parametrize('arguments', [(), ('--frobnicate', 'x'), ('x', '--start', 'soon')])
def test_wrong_usage_is_one_line(run, tmp_path, arguments):
    done = run('replay', *arguments)
    assert done.status == 2
    assert done.complaint.endswith('(see polymap_replay --help)')
    assert done.err.count('\n') == 1


def test_a_state_that_is_none(call, triangle, tmp_path):
    (tmp_path / 'state.npz').write_bytes(b'nothing')
    assert 'state.npz: is no saved state' in refused(call, tmp_path, triangle, '-p', 'output.load_path:=state.npz')


def test_a_result_folder_that_cannot_be_made(call, triangle, tmp_path):
    (tmp_path / 'file').write_text('in the way')
    done = call('replay', triangle, '--output', 'file', *FAST)
    assert (done.status, done.complaint) == (
        2, 'polymap_replay: error: file: cannot be written: it is a file; choose another folder')
    assert done.out == ''  # it is told before the work
    assert (tmp_path / 'file').read_text() == 'in the way'
    done = call('replay', triangle, '--output', 'file/out', *FAST)
    assert done.status == 2
    assert done.complaint.startswith('polymap_replay: error: file')
    assert [path.name for path in tmp_path.iterdir()] == ['file']


@pytest.mark.parametrize(('name', 'arguments'), [
    ('replay', ('none.mcap', '--output', '')), ('replay', ('',)), ('replay', ('none.mcap', '--params-file', '')),
    ('simulate', ('triangle', '--output', '')), ('evaluate', ('random', '--output', ''))])
def test_an_empty_path_is_refused_before_the_work(tmp_path, monkeypatch, capsys, name, arguments):
    """A shell makes it of a variable that is not set."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as refused:
        importlib.import_module(f'polymap_ros.commands.{name}').main(arguments)
    assert refused.value.code == 2
    option = next((each for each in arguments if each.startswith('--')), 'RECORDING')
    assert f"argument {option}: '' names nothing; write . for the current folder" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
