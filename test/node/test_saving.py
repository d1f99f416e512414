"""Saves that are killed, or that the disk refuses: what was there stays whole, nothing half-written is a result."""

import json
import os
import resource
import signal
import subprocess
import sys
import threading
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

pytest.importorskip('rclpy')

from polymap_ros.errors import OutputError
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.node.factory import message_class
from polymap_ros.node.saving import Saved, Saver, write
from polymap_ros.node.stopwatch import Stopwatch
from polymap_ros.parameters import Parameters
from polymap_ros.results.arrays import read_state
from polymap_ros.results.folder import Unwritten
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import pings
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate

TRIGGER = 'std_srvs/srv/Trigger'
RELIABLE = [part for topic in ('odom', 'echo')
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]
RELIABLE += ['-p', 'solver.method:=paper']
KILLS = 40
FILES = {'polygon.json', 'state.npz', 'trajectory.tum', 'map.pgm', 'map.yaml'}

WRITER = """
import os, signal, sys, time
import numpy as np
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.geometry.pose import Pose
from polymap_ros.node.saving import write
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import pings

parameters = Parameters().replaced({'solver.method': 'paper', 'solver.iterations': 50, 'output.dir': sys.argv[1]})
mapper, scene = PolygonMapper(parameters), load_scene('triangle')
for pose, ping in zip(scene.poses, pings(scene)):
    mapper.add_pose(ping.emission_ns, Pose(*pose))
    mapper.add_ping(ping)
estimate = mapper.solve()
begun = time.monotonic()
write(mapper, estimate, parameters)
whole_s = time.monotonic() - begun
for kill in range(int(sys.argv[2])):
    child = os.fork()
    if child == 0:
        while True:
            write(mapper, estimate, parameters)
    time.sleep(2.0 * whole_s * (kill + 0.5) / int(sys.argv[2]))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
write(mapper, estimate, parameters)
"""


TOGETHER = """
import sys
from polymap_ros.solvers.estimate import Estimate
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.node.saving import write
from polymap_ros.parameters import Parameters

parameters = Parameters().replaced({'output.dir': sys.argv[1]})
for _ in range(50):
    write(PolygonMapper(parameters), Estimate('open', 'evidence'), parameters)
"""


def results(folder):
    """What a user takes for results: everything but hidden names."""
    return [path for path in folder.iterdir() if not path.name.startswith('.')]


def assert_whole(folder):
    assert {path.name for path in folder.iterdir()} == FILES
    document = json.loads((folder / 'polygon.json').read_text())
    parameters = Parameters().replaced({name: document['parameters'][name] for name in ('solver.method',)})
    mapper = PolygonMapper.from_state(parameters, read_state(folder / 'state.npz'))
    assert mapper.counts.used == document['pings']['used'] > 0
    pgm_is_whole(folder / 'map.pgm')


def pgm_is_whole(path):
    magic, *rest = path.read_bytes().split(maxsplit=4)
    assert magic == b'P5'
    assert (int(rest[2]), len(rest[3])) == (255, int(rest[0]) * int(rest[1]))


def test_kill_at_any_moment_of_a_save_leaves_whole_results_only(tmp_path):
    """What was half-written is gone with the save after it."""
    subprocess.run([sys.executable, '-c', WRITER, str(tmp_path), str(KILLS)], check=True, timeout=120)
    whole = results(tmp_path)
    assert whole == list(tmp_path.iterdir())
    assert len(whole) > 1, 'no child got to the end of a save'
    for folder in whole:
        assert_whole(folder)


def test_nodes_that_save_side_by_side_at_the_same_stamp_do_not_get_in_each_others_way(tmp_path):
    processes = [subprocess.Popen([sys.executable, '-c', TOGETHER, str(tmp_path)]) for _ in range(3)]
    assert [process.wait(120) for process in processes] == [0, 0, 0]
    assert {path.name for path in tmp_path.iterdir()} == {f'0-{n}' for n in range(1, 151)}
    for folder in tmp_path.iterdir():
        assert {path.name for path in folder.iterdir()} == {'polygon.json', 'state.npz', 'trajectory.tum'}


def test_a_save_without_a_map_or_a_state_says_so(tmp_path):
    """Files may have 1 kB, and then so much that only the map is too large."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    parameters = Parameters().replaced({'output.dir': str(tmp_path), 'map.margin_m': 4.0})
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    edges = tuple(Edge(r, theta, 1.0) for r, theta in ((0.0, -np.pi / 2), (np.sqrt(0.5), np.pi / 4), (0.0, np.pi)))
    mapper = PolygonMapper(parameters)
    estimate = Estimate('closed', 'evidence', polygon=Candidate(corners, edges))
    missing = []
    try:
        for size in (6_000, 3_000_000):
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
            saved = write(mapper, estimate, parameters)
            names = {path.name for path in saved.folder.iterdir()}
            missing.append((saved.whole, saved.problem.partition(': ')[0], names))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert missing == [
        (False, 'state.npz', {'polygon.json', 'trajectory.tum'}),
        (True, 'map.pgm and map.yaml', {'polygon.json', 'state.npz', 'trajectory.tum'})]


def test_the_log_says_of_every_save_asked_for_what_the_service_says(tmp_path, monkeypatch):
    logged, written, served = [], threading.Event(), []
    logger = SimpleNamespace(error=lambda text, **options: logged.append(('error', text, options)),
                             info=lambda text: logged.append(('info', text, {})))
    node = SimpleNamespace(get_logger=lambda: logger, create_service=lambda *arguments, **options: None,
                           executor=Mock(create_task=lambda task: (task(), written.set())))
    parameters = Parameters().replaced({'output.dir': str(tmp_path)})
    saver = Saver(node, PolygonMapper(parameters), lambda: parameters, Stopwatch())
    missing = Saved(tmp_path / 'b', (Unwritten(('state.npz',), 'no space'),))
    for outcome in (Saved(tmp_path / 'a', ()), missing, missing, OutputError(tmp_path, 'full')):
        def give(*arguments, outcome=outcome):
            if isinstance(outcome, Exception):
                raise outcome
            return outcome

        monkeypatch.setattr('polymap_ros.node.saving.write', give)
        written.clear()
        serving = saver._serve(None, SimpleNamespace())
        try:
            serving.send(None)
            assert written.wait(30.0)
            serving.send(None)
        except StopIteration as end:
            served.append(end.value)
    saver.close()
    assert [each.success for each in served] == [True, False, False, False]
    assert served[0].message == str(tmp_path / 'a')
    assert logged == [('info', f'saved: {tmp_path / "a"}', {}), *(('error', each.message, {}) for each in served[1:])]


def test_a_save_that_a_reset_overtakes_takes_the_place_of_the_one_before(tmp_path):
    """The second of the first map is not over yet as the map is reset."""
    node = SimpleNamespace(get_logger=lambda: SimpleNamespace(info=print, error=print),
                           create_service=lambda *arguments, **options: None)
    parameters = Parameters().replaced({'output.dir': str(tmp_path), 'output.autosave_s': 1e-9,
                                        'solver.method': 'paper'})
    mapper, scene = PolygonMapper(parameters), load_scene('triangle')
    saver = Saver(node, mapper, lambda: parameters, Stopwatch())
    ride = list(zip(pings(scene), scene.poses, strict=True))

    def save_with(*numbers):
        for ping, pose in ride[slice(*numbers)]:
            mapper.add_pose(ping.emission_ns, Pose(*pose))
            mapper.add_ping(ping)
        saver.autosave()
        saver._automatic[1].exception(30.0)

    save_with(0, 4)
    save_with(4, 8)
    saver.begin_anew()
    mapper.reset()
    save_with(10, 12)
    save_with(12, 14)
    saver.close()
    stamps = sorted(int(folder.name.partition('-')[0]) for folder in tmp_path.iterdir())
    assert stamps == [ride[7][0].emission_ns, ride[13][0].emission_ns]


def test_node_that_is_killed_leaves_the_saves_it_has_answered_for(peer, start, tmp_path, riding):
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path}')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 30)
    peer.until_used(values, 30)
    peer.spin_until(lambda: values().get('status') == 'closed', 'a polygon')
    saved = peer.call('/polymap_node/save', TRIGGER)
    client = peer.node.create_client(message_class(TRIGGER), '/polymap_node/save')
    peer.spin_until(client.service_is_ready, 'no service')
    client.call_async(message_class(TRIGGER).Request())
    peer.spin_until(lambda: any(path.name.startswith('.') for path in tmp_path.iterdir()) or len(results(tmp_path)) > 1,
                    'the second save has not begun')
    os.killpg(node.popen.pid, signal.SIGKILL)
    node.popen.wait()
    assert saved.message in map(str, results(tmp_path))
    for folder in results(tmp_path):
        assert_whole(folder)
    start('--ros-args', *RELIABLE, '-p', f'output.load_path:={saved.message}/state.npz')
    peer.spin_until(lambda: values().get('pings used') == '30', 'the map to go on from')


def test_full_disk_is_told_and_the_node_goes_on(peer, start, tmp_path, riding):
    """No file may grow beyond 2 kB: what writing to a full disk is like."""
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path}')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 10)
    peer.until_used(values, 10)
    unlimited = resource.prlimit(node.popen.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(node.popen.pid, resource.RLIMIT_FSIZE, (2048, unlimited[1]))
    refused = peer.call('/polymap_node/save', TRIGGER)
    assert not refused.success
    assert refused.message.startswith('cannot save: ')
    assert 'File too large' in refused.message
    assert list(tmp_path.iterdir()) == []
    peer.spin_until(lambda: 'cannot save' in values()['message'], 'the reason in the diagnostics')
    assert values()['level'] == '2'
    ride.publish(10, 20)
    peer.until_used(values, 20)
    resource.prlimit(node.popen.pid, resource.RLIMIT_FSIZE, unlimited)
    assert peer.call('/polymap_node/save', TRIGGER).success
    peer.spin_until(lambda: 'cannot save' not in values()['message'], 'the end of the trouble')


def test_a_last_save_with_room_for_the_polygon_alone_stays_beside_the_whole_one_before(peer, start, tmp_path, riding):
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path}', '-p', 'output.autosave_s:=0.2')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 5)
    peer.spin_until(lambda: values().get('saved'), 'an automatic save')
    resource.prlimit(node.popen.pid, resource.RLIMIT_FSIZE,
                     (6_000, resource.prlimit(node.popen.pid, resource.RLIMIT_FSIZE)[1]))
    ride.publish(5, 8)
    peer.until_used(values, 8)
    node.wait_for_line('state.npz: not written: ')
    assert node.stop(signal.SIGTERM) == 0
    folders = sorted(results(tmp_path), key=lambda folder: int(folder.name.partition('-')[0]))
    # What lies between has files that the newest lacks.
    older, *_, newest = ({path.name for path in folder.iterdir()} for folder in folders)
    assert {'polygon.json', 'state.npz', 'trajectory.tum'} <= older
    assert 'polygon.json' in newest
    assert 'state.npz' not in newest


SLOW_DISK = """import os, time
whole = os.fsync
os.fsync = lambda descriptor: (time.sleep(0.2), whole(descriptor))
"""


def test_signals_while_the_map_is_saved_at_the_end_do_not_cut_it_short(peer, start, tmp_path, riding, monkeypatch):
    """A disk that takes its time, an impatient user, and a launch file that goes on to SIGTERM."""
    (tmp_path / 'slow').mkdir()
    (tmp_path / 'slow' / 'sitecustomize.py').write_text(SLOW_DISK)
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join((str(tmp_path / 'slow'), os.environ.get('PYTHONPATH', ''))))
    saves = tmp_path / 'saves'
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={saves}', '-p', 'output.autosave_s:=1000.0')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 8)
    peer.until_used(values, 8)
    os.killpg(node.popen.pid, signal.SIGINT)
    node.wait_for_line(f'saving the map to {saves}: wait for it')
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        os.killpg(node.popen.pid, number)
    assert node.end() == 0
    folder, = results(saves)
    assert {path.name for path in folder.iterdir()} >= {'polygon.json', 'state.npz', 'trajectory.tum'}
    assert f'saved: {folder}' in '\n'.join(node.lines)
    assert not any('Traceback' in line or 'Exception' in line for line in node.lines)


def test_a_client_has_its_answer_though_the_node_ends_meanwhile(peer, start, tmp_path, riding, monkeypatch):
    (tmp_path / 'slow').mkdir()
    (tmp_path / 'slow' / 'sitecustomize.py').write_text(SLOW_DISK)
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join((str(tmp_path / 'slow'), os.environ.get('PYTHONPATH', ''))))
    saves = tmp_path / 'saves'
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={saves}')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 8)
    peer.until_used(values, 8)
    client = peer.node.create_client(message_class(TRIGGER), '/polymap_node/save')
    peer.spin_until(client.service_is_ready, 'no service')
    answer = client.call_async(message_class(TRIGGER).Request())
    peer.spin_until(lambda: saves.exists() and any(path.name.startswith('.') for path in saves.iterdir()), 'the save')
    os.killpg(node.popen.pid, signal.SIGINT)
    peer.spin_until(answer.done, 'the answer')
    assert answer.result().success
    assert node.end() == 0
    assert answer.result().message in map(str, results(saves))


def test_results_land_where_the_node_was_started_though_that_folder_was_removed(
        peer, start, tmp_path, riding, monkeypatch):
    (tmp_path / 'gone').mkdir()
    monkeypatch.chdir(tmp_path / 'gone')
    node = start('--ros-args', *RELIABLE, '-p', 'output.dir:=maps', '-p', 'output.autosave_s:=1000.0')
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'gone').rmdir()
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 5)
    peer.until_used(values, 5)
    assert node.stop() == 0
    folder, = results(tmp_path / 'gone' / 'maps')
    assert {path.name for path in folder.iterdir()} >= {'polygon.json', 'state.npz', 'trajectory.tum'}


def test_a_last_save_that_fails_is_told_even_if_the_one_before_it_just_was(peer, start, tmp_path, riding):
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path / "maps"}', '-p', 'output.autosave_s:=0.2')
    (tmp_path / 'maps').write_text('a file')
    riding().publish(0, 5)
    node.wait_for_line('cannot save: ')
    os.killpg(node.popen.pid, signal.SIGINT)
    node.wait_for_line('saving the map to ')
    node.wait_for_line('cannot save: ')
    assert node.end() == 0
