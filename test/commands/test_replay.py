"""polymap_replay as a user runs it: files, summary, options, exit status."""

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from rosbags.highlevel import AnyReader

from polymap_ros.commands import console
from polymap_ros.parameters import Parameters
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.writing import RecordingWriter

BAGS = Path(__file__).parents[2] / 'bags'
FAST = ('-p', 'solver.method:=paper', '-p', 'solver.iterations:=60')


def read_json(path):
    def refuse(name):
        raise AssertionError(f'{name} is not JSON')

    return json.loads(path.read_text(encoding='utf-8'), parse_constant=refuse)


def test_a_recording_may_have_more_parts_than_a_process_may_have_files_at_first(triangle, tmp_path):
    (tmp_path / 'drive').mkdir()
    with Recording.open(triangle) as recording:
        for number, entry in enumerate(recording.messages()):
            with RecordingWriter(tmp_path / 'drive' / f'run_{number}.mcap') as writer:
                writer.write(entry.topic, entry.message, entry.log_ns)
    code = ('import resource as r, sys; r.setrlimit(r.RLIMIT_NOFILE, (60, r.getrlimit(r.RLIMIT_NOFILE)[1])); '
            'from polymap_ros.commands.replay import main; sys.exit(main(sys.argv[1:]))')
    done = subprocess.run([sys.executable, '-c', code, 'drive', *FAST], cwd=tmp_path, capture_output=True, text=True,
                          timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert 'odometry: 245 received, 245 used' in done.stdout


@pytest.mark.parametrize('method', ['evidence', 'paper'])
def test_the_triangle_is_found(run, triangle, tmp_path, method):
    done = run('replay', triangle, '--output', 'out', '-p', f'solver.method:={method}')
    assert done.status == 0, done.err
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {
        'polygon.json', 'state.npz', 'trajectory.tum', 'map.pgm', 'map.yaml'}
    assert 'closed: 3 edges' in done.out
    assert 'against the truth: 3 edges of 3, right' in done.out
    assert 'triangle: reading: 100%' in done.err
    assert 'triangle: solving' in done.err

    found = read_json(tmp_path / 'out' / 'polygon.json')
    truth = np.array(read_json(triangle / 'truth.json')['vertices'])
    assert (found['format'], found['status'], found['frame_id'], found['method']) == (
        'polymap/1', 'closed', 'odom', method)
    assert found['pings'] == {'received': 60, 'used': 60, 'dropped': {}}
    assert (found['walls'], found['alternatives'], found['warnings']) == ([], [], [])
    assert found['parameters'] == Parameters().flat() | {'solver.method': method}
    vertices = np.array(found['vertices'])
    room = shapely.Polygon(vertices)
    assert room.exterior.is_ccw
    assert room.intersection(shapely.Polygon(truth)).area / room.union(shapely.Polygon(truth)).area > 0.98
    for edge, a, b in zip(found['edges'], vertices, np.roll(vertices, -1, axis=0), strict=True):
        normal = np.array([np.cos(edge['theta']), np.sin(edge['theta'])])
        np.testing.assert_allclose([normal @ a, normal @ b], edge['r'], atol=1e-9)  # edge i from vertex i to i + 1
        assert normal @ vertices.mean(axis=0) < edge['r']  # the normal points outward
        assert 0.0 < edge['likelihood'] <= 1.0
        assert (edge['r_std'] is None) == (edge['theta_std'] is None) == (method == 'paper')
        assert 0 < edge['pings'] <= 60


def test_the_same_recording_gives_the_same_bytes_in_any_layout(call, triangle, altered, tmp_path):
    bare = shutil.copy(triangle / 'triangle.mcap', tmp_path / 'bare.mcap')
    sqlite = altered(lambda topic, index, message: [(topic, message)], storage='sqlite3')
    for name, recording in {'a': triangle, 'b': triangle, 'c': bare, 'd': sqlite}.items():
        assert call('replay', recording, '--output', name, '--save-map', *FAST).status == 0
    for file in ('polygon.json', 'state.npz', 'trajectory.tum', 'map.pgm', 'map.yaml', 'beam_map.npz'):
        contents = {re.sub(rb'"recording": "\w+"', b'', (tmp_path / name / file).read_bytes()) for name in 'abcd'}
        assert len(contents) == 1, file
    named = [read_json(tmp_path / name / 'polygon.json')['recording'] for name in 'abcd']
    assert named == ['triangle', 'triangle', 'bare', 'altered']
    assert str(tmp_path) not in (tmp_path / 'a' / 'polygon.json').read_text()


def test_everything_that_can_be_asked_for(call, triangle, tmp_path):
    done = call('replay', triangle, '--output', 'out', '--plot', '--record', '--save-map', *FAST)
    assert done.status == 0, done.err
    out = tmp_path / 'out'
    assert {path.name for path in out.iterdir()} == {
        'polygon.json', 'state.npz', 'trajectory.tum', 'map.pgm', 'map.yaml', 'polygon.png', 'result.mcap',
        'beam_map.npz'}
    assert (out / 'polygon.png').read_bytes().startswith(b'\x89PNG')
    found = read_json(out / 'polygon.json')

    with np.load(out / 'beam_map.npz', allow_pickle=False) as arrays:
        values, r_m, theta_rad = arrays['map'], arrays['r_m'], arrays['theta_rad']
        x, y, yaw = arrays['start_pose']
    assert (values.shape, values.dtype) == ((360, 601), np.float32)
    for edge in found['edges']:  # seen from the start pose, the map has each edge's likelihood at its place
        row = round(np.rad2deg(edge['theta'] - yaw)) % 360
        column = round((edge['r'] - x * np.cos(edge['theta']) - y * np.sin(edge['theta'])) / 0.005)
        assert values[row, column] / values.max() == pytest.approx(edge['likelihood'], rel=1e-5)
    np.testing.assert_allclose(r_m, np.arange(601) * 0.005, atol=1e-12)
    np.testing.assert_allclose(theta_rad, np.deg2rad(np.arange(360)))

    with AnyReader([out / 'result.mcap']) as reader:
        counts = {name: info.msgcount for name, info in reader.topics.items()}
        last = {c.topic: reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()}
        first_ns = {c.topic: log_ns for c, log_ns, _ in reversed(list(reader.messages()))}
    with AnyReader([triangle]) as reader:
        assert counts['/odom'] == reader.topics['/odom'].msgcount
    outputs = [f'/polymap_node/{name}' for name in ('polygon', 'markers', 'beam_map', 'map', 'path', 'pose')]
    assert counts.keys() == {'/odom', '/diagnostics', *outputs}
    assert all(first_ns[topic] > first_ns['/odom'] for topic in outputs)  # as they grew
    points = last['/polymap_node/polygon'].polygon.points
    np.testing.assert_allclose([[p.x, p.y] for p in points], found['vertices'], atol=1e-6)
    assert last['/polymap_node/polygon'].header.frame_id == 'odom'
    beam_map = last['/polymap_node/beam_map']
    assert beam_map.header.frame_id == 'polymap_node/start'
    np.testing.assert_array_equal(beam_map.data.view(np.float32).reshape(values.shape), values)
    grid = last['/polymap_node/map']
    description = yaml.safe_load((out / 'map.yaml').read_text())
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == tuple(description['origin'][:2])
    assert set(np.unique(grid.data)) == {-1, 0, 100}


def test_results_of_an_earlier_run_are_replaced(call, triangle, tmp_path):
    assert call('replay', triangle, '--output', 'out', '--plot', '--save-map', *FAST).status == 0
    (tmp_path / 'out' / 'notes.txt').write_text('mine')
    assert call('replay', triangle, '--output', 'out', *FAST).status == 0
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {
        'polygon.json', 'state.npz', 'trajectory.tum', 'map.pgm', 'map.yaml', 'notes.txt'}


def test_exports_lie_beside_the_other_results(call, triangle, tmp_path):
    exports = (word for kind in ('csv', 'geojson', 'dxf') for word in ('--export', kind))
    done = call('replay', triangle, '--output', 'out', *exports, *FAST)
    assert done.status == 0, done.err
    found = read_json(tmp_path / 'out' / 'polygon.json')
    feature = read_json(tmp_path / 'out' / 'polygon.geojson')
    assert feature['geometry']['coordinates'][0][:-1] == found['vertices']
    assert len((tmp_path / 'out' / 'polygon.csv').read_text().splitlines()) == 1 + len(found['edges'])
    assert (tmp_path / 'out' / 'polygon.dxf').stat().st_size > 1000
    # Too short to close: what an earlier run exported is not left behind as if it were this one's.
    done = call('replay', triangle, '--output', 'out', '--end', '1', '--export', 'dxf', '--export', 'geojson', *FAST)
    assert done.status == 1
    assert 'no polygon.dxf, polygon.geojson: there is no polygon to export' in done.out.splitlines()
    assert list((tmp_path / 'out').glob('polygon.*')) == [tmp_path / 'out' / 'polygon.json']


def test_the_default_folder_is_the_output_parameter(call, triangle, tmp_path):
    assert call('replay', triangle, *FAST).status == 0
    assert (tmp_path / 'polymap' / 'polygon.json').exists()
    assert call('replay', triangle, '-p', 'output.dir:=there', *FAST).status == 0
    assert (tmp_path / 'there' / 'polygon.json').exists()


def test_parameters_come_from_the_file_and_then_from_the_command_line(call, triangle, tmp_path):
    (tmp_path / 'p.yaml').write_text('polymap_node: {ros__parameters: {solver: {iterations: 7, seed: 3}}}')
    done = call('replay', triangle, '--output', 'out', '--params-file', 'p.yaml', '-p', 'solver.iterations:=60',
               '-p', 'grid.range_step_m:=0.01')
    assert done.status == 0, done.err
    used = read_json(tmp_path / 'out' / 'polygon.json')['parameters']
    assert (used['solver.iterations'], used['solver.seed'], used['grid.range_step_m']) == (60, 3, 0.01)


def test_a_span_of_the_recording(call, triangle, tmp_path):
    done = call('replay', triangle, '--output', 'out', '--start', '5', '--end', '20', *FAST)
    assert done.status in (0, 1)
    pings = read_json(tmp_path / 'out' / 'polygon.json')['pings']
    assert 25 <= pings['received'] <= 31  # a ping every half second
    assert pings['used'] + sum(pings['dropped'].values()) == pings['received']


def test_several_recordings_have_a_folder_each_and_the_highest_status(run, triangle, tmp_path):
    bare = shutil.copy(triangle / 'triangle.mcap', tmp_path / 'bare.mcap')
    done = run('replay', triangle, bare, 'none.mcap', '--output', 'out', *FAST)
    assert done.status == 2
    assert done.complaint == 'polymap_replay: error: none.mcap: no such recording'
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {'triangle', 'bare', 'summary.csv'}
    one, other = (read_json(tmp_path / 'out' / name / 'polygon.json') for name in ('triangle', 'bare'))
    assert (one.pop('recording'), other.pop('recording')) == ('triangle', 'bare')
    assert one == other
    assert done.out.splitlines()[-1] == '2 done, 0 open, 1 failed; out/summary.csv'


def test_two_recordings_of_one_name_are_refused(call, triangle, tmp_path):
    shutil.copy(triangle / 'triangle.mcap', tmp_path / 'triangle.mcap')
    done = call('replay', triangle, 'triangle.mcap', '--output', 'out')
    assert done.status == 2
    assert '2 recordings are called triangle' in done.complaint
    assert not (tmp_path / 'out').exists()


def test_results_take_the_place_of_nothing_that_is_read(call, triangle, tmp_path):
    """A recording called as a result is, and the parameter file of an earlier calibration."""
    (tmp_path / 'run').mkdir()
    (tmp_path / 'runs').mkdir()
    (tmp_path / 'runs' / 'triangle').symlink_to('../run')
    shutil.copy(triangle / 'triangle.mcap', tmp_path / 'run' / 'result.mcap')
    (tmp_path / 'run' / 'calibration.yaml').write_text('/**:\n  ros__parameters:\n    solver:\n      seed: 3\n')
    before = {path.name: path.read_bytes() for path in (tmp_path / 'run').iterdir()}
    for recordings, options in (
        (['run/result.mcap'], ['--output', 'run']),
        ([triangle, 'run/result.mcap'], ['--output', 'runs']),
        ([triangle], ['--params-file', 'run/calibration.yaml', '--output', 'run']),
    ):
        done = call('replay', *recordings, *options, *FAST)
        assert done.status == 2
        assert 'is read, and the results would take its place' in done.complaint
    done = call('replay', 'run', '--output', 'run', '--record', *FAST)  # a result is no part of a recording
    assert (done.status, 'is no recording' in done.complaint) == (2, True)
    assert before == {path.name: path.read_bytes() for path in (tmp_path / 'run').iterdir()}


def test_several_recordings_never_leave_the_output_folder(call, triangle, tmp_path, monkeypatch):
    shutil.copytree(triangle, tmp_path / 'bag' / 'inner')
    shutil.copy(triangle / 'triangle.mcap', tmp_path / '...mcap')
    monkeypatch.chdir(tmp_path / 'bag' / 'inner')
    done = call('replay', '.', triangle, '--output', tmp_path / 'out', *FAST)
    assert done.status == 0, done.err
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == ['inner', 'summary.csv', 'triangle']
    done = call('replay', tmp_path / '...mcap', triangle, '--output', tmp_path / 'other', *FAST)
    assert (done.status, 'has no name' in done.complaint) == (2, True)
    assert not (tmp_path / 'other').exists()


def test_a_saved_state_is_continued(call, triangle, tmp_path):
    """Two halves one after the other give the map of the whole."""
    with AnyReader([triangle]) as reader:
        middle_s = (reader.duration // 2) * 1e-9
    assert call('replay', triangle, '--output', 'whole', '--save-map', *FAST).status == 0
    call('replay', triangle, '--output', 'first', '--end', middle_s, *FAST)
    done = call('replay', triangle, '--output', 'second', '--start', middle_s, '--save-map',
               '-p', 'output.load_path:=first/state.npz', *FAST)
    assert done.status == 0, done.err
    whole, second = (read_json(tmp_path / name / 'polygon.json') for name in ('whole', 'second'))
    assert second['pings'] == whole['pings']
    maps = [np.load(tmp_path / name / 'beam_map.npz')['map'] for name in ('whole', 'second')]
    np.testing.assert_allclose(maps[0], maps[1], rtol=0, atol=1e-5 * maps[0].max())


def test_a_state_and_the_same_recording_again_give_the_map_of_twice_as_many_pings(call, triangle, tmp_path):
    assert call('replay', triangle, '--output', 'first', *FAST).status == 0
    load = ['-p', 'output.load_path:=first/state.npz']
    assert call('replay', triangle, '--output', 'second', *load, *FAST).status == 0
    one, two = (read_json(tmp_path / name / 'polygon.json') for name in ('first', 'second'))
    assert two['pings']['used'] == 2 * one['pings']['used'] > 0
    assert two['stamp_ns'] == one['stamp_ns']
    ignored = call('replay', triangle, '--output', 'third', *load, '-p', 'odometry.on_jump_back:=ignore', *FAST)
    assert ignored.status == 2
    assert 'out_of_order' in ignored.complaint


def test_without_truth_nothing_is_compared(call, triangle, tmp_path):
    shutil.copy(triangle / 'triangle.mcap', tmp_path / 'bare.mcap')
    done = call('replay', 'bare.mcap', '--output', 'out', *FAST)
    assert 'truth' not in done.out
    assert done.status == 0


@pytest.mark.parametrize(('number', 'status', 'word'), [
    (signal.SIGINT, 130, 'interrupted'), (signal.SIGTERM, 143, 'terminated'), (signal.SIGHUP, 129, 'hung up')])
@pytest.mark.parametrize('moment', ['reading', 'solving'])
def test_a_signal_ends_it_and_nothing_is_written(start, triangle, tmp_path, moment, number, status, word):
    process = start('replay', triangle, '--output', 'out', '-p', 'solver.method:=paper',
                    '-p', 'solver.iterations:=1000000')
    seen, deadline = b'', time.monotonic() + 120.0
    while f'triangle: {moment}'.encode() not in seen and time.monotonic() < deadline:
        seen += process.stderr.read1(4096)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == status, seen + err
    assert b'Traceback' not in seen + err
    assert err.decode().splitlines()[-1] == f'polymap_replay: {word}'
    assert out == b''
    assert list(tmp_path.iterdir()) == []


def test_sigterm_while_the_results_are_written_leaves_nothing(call, triangle, tmp_path, monkeypatch):
    """The signal comes when the folder beside the results holds some of them, but not all."""
    def signalled(*arguments):
        assert any(path.name.startswith('.out.polymap-') for path in tmp_path.iterdir())
        os.kill(os.getpid(), signal.SIGTERM)
        return b''

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr('polymap_ros.results.save.state_npz', signalled)
    done = call('replay', triangle, '--output', 'out', *FAST)
    assert (done.status, done.complaint) == (143, 'polymap_replay: terminated')
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(signal.SIGTERM) is before


def test_help_names_every_option(run):
    done = run('replay', '--help')
    assert done.status == 0
    for option in ('--params-file', '-p', '--output', '--start', '--end', '--plot', '--record', '--export',
                   '--save-map'):
        assert option in done.out
    assert 'the parameter output.dir, which is polymap' in ' '.join(done.out.split())


def test_a_reader_of_the_summary_may_leave(start, triangle, tmp_path):
    bare = shutil.copy(triangle / 'triangle.mcap', tmp_path / 'bare.mcap')
    process = start('replay', triangle, '-p', 'solver.seed:=2', bare, '--output', 'out', *FAST)
    process.stdout.close()
    err = process.stderr.read()
    assert process.wait(timeout=60) == 0
    assert b'Error' not in err
    assert (tmp_path / 'out' / 'triangle' / 'polygon.json').exists()
    assert (tmp_path / 'out' / 'bare' / 'polygon.json').exists()


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='no device that is always full')
@pytest.mark.parametrize('jobs', [(), ('--jobs', '2')])
def test_the_work_is_done_where_nothing_can_be_said_of_it(run, triangle, tmp_path, jobs):
    with Path('/dev/full').open('w') as full:
        silent = run('replay', triangle, '--output', 'a', *FAST, *jobs, stderr=full)
        assert silent.status == 0
        assert 'triangle: closed: ' in silent.out
        assert run('replay', 'nowhere', stderr=full).status == 2
        assert run('replay', '--nothing', stderr=full).status == 2
        unheard = run('replay', triangle, '--output', 'b', *FAST, *jobs, stdout=full)
    assert unheard.status == 2
    assert unheard.complaint.startswith('polymap_replay: error: standard output: No space left on device')
    assert {path.name for path in (tmp_path / 'a').iterdir()} == {path.name for path in (tmp_path / 'b').iterdir()}


def test_the_signals_are_drawn_on_request(call, triangle, tmp_path):
    pytest.importorskip('matplotlib')
    assert call('replay', triangle, '--output', 'out', '--plot-signals', '-p', 'solver.method:=rectangle').status == 0
    assert (tmp_path / 'out' / 'signals.png').read_bytes().startswith(b'\x89PNG')


def test_a_map_too_large_costs_the_map_alone(call, triangle, tmp_path):
    done = call('replay', triangle, '--output', 'out', *FAST, '-p', 'map.resolution_m:=1e-5')
    assert done.status == 0, done.err
    assert done.complaint.startswith(f'polymap_replay: warning: {triangle}: there is no map: a place of ')
    assert 'set map.resolution_m to 0.005' in done.complaint
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {'polygon.json', 'state.npz', 'trajectory.tum'}
    assert [each['code'] for each in read_json(tmp_path / 'out' / 'polygon.json')['warnings']] == ['map_too_large']


def test_a_large_place_has_a_map_of_larger_cells(call, triangle, tmp_path):
    """The place is the margin's."""
    done = call('replay', triangle, '--output', 'out', *FAST, '-p', 'map.margin_m:=30')
    assert done.status == 0, done.err
    assert 'the cells of the map are 0.01 m wide' in done.complaint
    assert yaml.safe_load((tmp_path / 'out' / 'map.yaml').read_text())['resolution'] == 0.01
    assert [each['code'] for each in read_json(tmp_path / 'out' / 'polygon.json')['warnings']] == ['map_coarse']


def test_what_a_full_disk_has_no_room_for_costs_itself(call, triangle, tmp_path):
    """polygon.json has 4 kB, the state megabytes; files may have 8 kB."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, before[1]))
    try:
        done = call('replay', triangle, '--output', 'out', '--export', 'csv', '--save-map', *FAST)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert done.status == 2
    assert 'triangle: closed: ' in done.out
    assert '; results in out' in done.out
    told = [line for line in done.err.replace('\r', '\n').splitlines() if line.startswith('polymap_')]
    assert [line.partition(': not written: ')[0] for line in told] == [
        f'polymap_replay: error: out/{names}' for names in ('state.npz', 'map.pgm and out/map.yaml', 'beam_map.npz')]
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {
        'polygon.json', 'polygon.csv', 'trajectory.tum'}


def test_an_answer_that_cannot_be_written_was_printed(call, triangle, tmp_path, monkeypatch):
    """A file takes the folder's place while the recording is solved."""
    def told(text):
        if not (tmp_path / 'out').exists():
            (tmp_path / 'out').write_text('in the way')
        tell(text)

    tell = console.tell
    monkeypatch.setattr(console, 'tell', told)
    done = call('replay', triangle, '--output', 'out', *FAST)
    assert (done.status, done.complaint) == (
        2, 'polymap_replay: error: out: cannot be written: File exists; choose another folder')
    assert 'triangle: closed: ' in done.out
    assert 'results in' not in done.out


def test_a_recording_is_localised_in_a_map(run, tmp_path):
    pentagon = BAGS / 'pentagon'
    assert run('replay', pentagon, '--output', 'map').status == 0
    localising = ('-p', 'slam.mode:=localization', '-p', 'output.load_path:=map')
    found = run('replay', pentagon, *localising, '--output', 'found')
    assert found.status == 0, found.err
    assert re.search(r'ATE 0\.[01]\d\d mm', found.out)
    given, document = (read_json(tmp_path / name / 'polygon.json') for name in ('map', 'found'))
    np.testing.assert_allclose(sorted(document['vertices']), sorted(given['vertices']), atol=1e-9)
    assert document['trajectory']['corrected']
    assert document['trajectory']['lost'] == 0
    missing = run('replay', pentagon, *localising[:2], '--output', 'none')
    assert (missing.status, missing.err.count('output.load_path')) == (2, 1)


def test_in_a_map_that_is_symmetric_the_reported_poses_decide(run, tmp_path):
    """Where the odometry began as it did for the map; where it began elsewhere, nothing does."""
    rectangle, localising = BAGS / 'rectangle', ('-p', 'slam.mode:=localization')
    assert run('replay', rectangle, '--output', 'map').status == 0
    found = run('replay', rectangle, *localising, '-p', 'output.load_path:=map', '--output', 'found')
    assert found.status == 0, found.err
    document = read_json(tmp_path / 'map' / 'polygon.json')
    document['vertices'] = (np.array(document['vertices']) + (5.0, -3.0)).tolist()
    (tmp_path / 'moved.json').write_text(json.dumps(document))
    both = run('replay', rectangle, *localising, '-p', 'output.load_path:=moved.json', '--output', 'both')
    assert both.status == 1
    assert 'fit 2 places in the map' in both.err
