"""Plates that stand upright: the triangle and its drive, turned in space."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polymap_ros.geometry.polygon_error import compare
from polymap_ros.recordings.reading import Recording

PAPER = ('-p', 'solver.method:=paper', '-p', 'solver.iterations:=100')
FIRST_POSE = (*PAPER, '-p', 'odometry.plane:=first_pose')
UPRIGHT = Rotation.from_euler('ZYX', [0.4, 0.3, 1.2])
OFFSET = np.array([5.0, -2.0, 12.0])
N_PINGS = 60


def moved(message, rotation=UPRIGHT, offset=OFFSET):
    """An odometry message turned about the origin and then moved."""
    pose = message.pose.pose
    place = rotation.apply([pose.position.x, pose.position.y, pose.position.z]) + offset
    turned = (rotation * Rotation.from_quat([getattr(pose.orientation, name) for name in 'xyzw'])).as_quat()
    pose.position.x, pose.position.y, pose.position.z = place.tolist()
    pose.orientation = type(pose.orientation)(*turned.tolist())
    return message


def changing(change):
    """Odometry through `change(index, message)`, echoes as they are."""
    return lambda topic, index, message: [(topic, change(index, message) if topic == '/odom' else message)]


def found(tmp_path):
    return json.loads((tmp_path / 'out' / 'polygon.json').read_text())


def corners(messages):
    return np.array([[point.x, point.y, point.z] for point in messages])


@pytest.fixture
def truth(triangle):
    return np.array(json.loads((triangle / 'truth.json').read_text())['vertices'])


def test_an_upright_plate_is_mapped_in_the_plane_of_the_first_pose(call, altered, tmp_path, truth):
    upright = altered(changing(lambda index, message: moved(message)), 'upright')
    done = call('replay', upright, '--output', 'out', '--record', *FIRST_POSE)
    assert done.status == 0, done.err
    assert 'corners counter-clockwise in the plane of the first pose in odom' in done.out
    document = found(tmp_path)
    assert document['pings'] == {'received': N_PINGS, 'used': N_PINGS, 'dropped': {}}
    plane = {name: np.array(value) for name, value in document['plane'].items()}
    in_space = plane['origin'] + np.array(document['vertices']) @ [plane['x_axis'], plane['y_axis']]
    flat = UPRIGHT.inv().apply(in_space - OFFSET)
    np.testing.assert_allclose(flat[:, 2], 0.0, atol=1e-9)
    assert compare(flat[:, :2], truth).right
    with Recording.open(tmp_path / 'out' / 'result.mcap') as recording:
        messages = {entry.topic.rpartition('/')[2]: entry.message for entry in recording.messages()}
    polygon = corners(messages['polygon'].polygon.points)
    assert messages['polygon'].header.frame_id == messages['map'].header.frame_id == 'odom'
    np.testing.assert_allclose(polygon, in_space, atol=1e-5)
    outline = next(each for each in messages['markers'].markers if each.ns == 'outline')
    np.testing.assert_allclose(corners(outline.points)[:-1], in_space, atol=1e-9)
    free = centres_of_free_cells(messages['map'])
    np.testing.assert_allclose(UPRIGHT.inv().apply(free - OFFSET)[:, 2], 0.0, atol=1e-6)
    np.testing.assert_allclose(free.mean(axis=0), in_space.mean(axis=0), atol=0.02)


def centres_of_free_cells(grid):
    """In the map's frame, through the pose of its origin."""
    cells = np.asarray(grid.data).reshape(grid.info.height, grid.info.width)
    rows, columns = np.nonzero(cells == 0)
    local = np.column_stack([columns + 0.5, rows + 0.5, np.zeros(len(rows))]) * grid.info.resolution
    origin = grid.info.origin
    rotation = Rotation.from_quat([getattr(origin.orientation, name) for name in 'xyzw'])
    return rotation.apply(local) + corners([origin.position])


def test_the_same_plate_in_the_xy_plane_is_off_plane_with_the_remedy(call, altered, tmp_path):
    upright = altered(changing(lambda index, message: moved(message)), 'upright')
    done = call('replay', upright, '--output', 'out', *PAPER)
    assert done.status == 1
    assert found(tmp_path)['pings'] == {'received': N_PINGS, 'used': 0, 'dropped': {'off_plane': N_PINGS}}
    assert 'off the mapping plane (odometry.plane); odometry.max_tilt_deg allows 10' in done.complaint


def test_on_flat_ground_both_planes_give_the_same_polygon(call, triangle, tmp_path):
    results = []
    for options in (PAPER, FIRST_POSE):
        assert call('replay', triangle, '--output', 'out', *options).status == 0
        results.append(found(tmp_path))
    xy, first = results
    assert 'plane' not in xy
    plane = first['plane']
    mapped = np.array(plane['origin']) + np.array(first['vertices']) @ [plane['x_axis'], plane['y_axis']]
    np.testing.assert_allclose(mapped[:, :2], xy['vertices'], atol=1e-6)


@pytest.mark.parametrize('plane', ['xy', 'first_pose'])
@pytest.mark.parametrize(('change', 'limit'), [
    (lambda message: moved(message, Rotation.identity(), np.array([0.0, 0.0, 0.3])), 'odometry.max_height_m:=0.5'),
    (lambda message: moved(message, Rotation.from_euler('x', 0.2), np.zeros(3)), 'odometry.max_tilt_deg:=20.0'),
], ids=['lifted', 'tilted'])
def test_pings_of_a_robot_that_left_the_plane_are_dropped(call, altered, tmp_path, plane, change, limit):
    """It is off the plane for a third of the drive; a wider limit takes the pings all the same."""
    off = altered(changing(lambda index, message: change(message) if 80 < index < 160 else message), 'off')
    options = (*PAPER, '-p', f'odometry.plane:={plane}')
    call('replay', off, '--output', 'out', *options)
    pings = found(tmp_path)['pings']
    assert 15 <= pings['dropped']['off_plane'] <= 25
    assert pings['used'] + pings['dropped']['off_plane'] == N_PINGS
    call('replay', off, '--output', 'out', *options, '-p', limit, '-p', 'odometry.max_height_m:=0.5')
    assert found(tmp_path)['pings']['used'] == N_PINGS


def test_an_upright_map_is_continued_where_it_stopped(call, altered, triangle, tmp_path):
    """Half the drive, its saved state, and the other half, against the whole drive at once."""
    upright = altered(changing(lambda index, message: moved(message)), 'upright')
    call('replay', upright, '--output', 'half', *FIRST_POSE, '--end', '15')
    done = call('replay', upright, '--output', 'out', *FIRST_POSE, '--start', '14.5', '-p',
                'output.load_path:=half/state.npz')
    assert done.status == 0, done.err
    continued = found(tmp_path)
    call('replay', upright, '--output', 'out', *FIRST_POSE)
    whole = found(tmp_path)
    assert continued['plane'] == whole['plane']
    np.testing.assert_allclose(continued['vertices'], whole['vertices'], atol=2e-3)
    done = call('replay', upright, '--output', 'out', *PAPER, '-p', 'output.load_path:=half/state.npz')
    assert (done.status, 'odometry.plane' in done.complaint) == (2, True)


def test_a_height_that_is_not_zero_from_the_start_is_no_matter(call, altered, tmp_path):
    """A base frame above the odometry's origin, as of a vehicle at depth."""
    deep = altered(changing(lambda index, message: moved(message, Rotation.identity(), np.array([0.0, 0.0, -20.0]))))
    assert call('replay', deep, '--output', 'out', '--record', *PAPER).status == 0
    assert found(tmp_path)['pings']['used'] == N_PINGS
    with Recording.open(tmp_path / 'out' / 'result.mcap') as recording:
        polygon = next(entry.message for entry in recording.messages(['/polymap_node/polygon']))
    assert {point.z for point in polygon.polygon.points} == {0.0}
