"""What is written comes back, through rosbags' own reader, and appears whole or not at all."""

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.writing import RecordingWriter, make

ODOMETRY, SCAN = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan'


def odometry(ns, x):
    stamp = make('builtin_interfaces/msg/Time', sec=ns // 10**9, nanosec=ns % 10**9)
    header = make('std_msgs/msg/Header', stamp=stamp, frame_id='odom')
    position = make('geometry_msgs/msg/Point', x=x)
    pose = make('geometry_msgs/msg/Pose', position=position)
    return make(ODOMETRY, header=header, pose=make('geometry_msgs/msg/PoseWithCovariance', pose=pose))


def read_all(path):
    with AnyReader([path]) as reader:
        return [(c.topic, c.msgtype, ns, reader.deserialize(raw, c.msgtype)) for c, ns, raw in reader.messages()]


@pytest.mark.parametrize(('name', 'storage'), [
    ('run', 'mcap'), ('run.1', 'sqlite3'), ('run.mcap', 'mcap'), ('run.db3', 'mcap')])
def test_messages_come_back_in_every_layout(tmp_path, name, storage):
    samples = np.linspace(-1.0, 1.0, 500, dtype=np.float32)
    with RecordingWriter(tmp_path / name, storage) as writer:
        writer.write('/odom', odometry(10, 0.25), 10)
        writer.write('/echo', make(SCAN, intensities=samples, time_increment=1e-6), 30)
        writer.write('/odom', odometry(1_500_000_020, 0.5), 20)

    (a, b, c) = read_all(tmp_path / name)
    assert [(m[0], m[1], m[2]) for m in (a, b, c)] == [
        ('/odom', ODOMETRY, 10), ('/odom', ODOMETRY, 20), ('/echo', SCAN, 30)]
    assert (a[3].pose.pose.position.x, a[3].pose.pose.orientation.w, a[3].header.frame_id) == (0.25, 1.0, 'odom')
    assert (b[3].header.stamp.sec, b[3].header.stamp.nanosec) == (1, 500_000_020)
    np.testing.assert_array_equal(c[3].intensities, samples)
    assert len(c[3].ranges) == 0
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_bare_mcap_is_read_by_the_reference_reader(tmp_path):
    path = tmp_path / 'run.mcap'
    with RecordingWriter(path) as writer:
        for k in range(5):
            writer.write('/odom', odometry(k, float(k)), k)
    with path.open('rb') as file:
        found = [(schema.name, channel.topic, message.log_time)
                 for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages()]
    assert found == [(ODOMETRY, '/odom', k) for k in range(5)]


def test_latched_topics_are_recorded_as_transient_local(tmp_path):
    with RecordingWriter(tmp_path / 'run', latched=['/polygon']) as writer:
        writer.write('/polygon', make('geometry_msgs/msg/PolygonStamped'), 1)
        writer.write('/odom', odometry(1, 0.0), 1)
    with AnyReader([tmp_path / 'run']) as reader:
        durability = {c.topic: c.ext.offered_qos_profiles[0].durability.name for c in reader.connections}
    assert durability == {'/polygon': 'TRANSIENT_LOCAL', '/odom': 'VOLATILE'}


@pytest.mark.parametrize('name', ['run', 'run.mcap', 'run.db3'])
def test_a_failure_leaves_nothing_behind(tmp_path, name):
    class Trouble(Exception):
        pass

    def write_half():
        with RecordingWriter(tmp_path / 'new' / name) as writer:
            writer.write('/odom', odometry(1, 0.0), 1)
            raise Trouble

    with pytest.raises(Trouble):
        write_half()
    assert list((tmp_path / 'new').iterdir()) == []


def test_nothing_is_overwritten(tmp_path):
    path = tmp_path / 'run.mcap'
    path.write_bytes(b'precious')
    with pytest.raises(RecordingError, match=r'run\.mcap: exists already'), RecordingWriter(path):
        pass
    assert path.read_bytes() == b'precious'
    assert list(tmp_path.iterdir()) == [path]


def test_an_unknown_storage_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"'csv' is not known; allowed: mcap \| sqlite3"):
        RecordingWriter(tmp_path / 'run', storage='csv')


def test_make_fills_in_every_default_and_knows_its_fields():
    marker = make('visualization_msgs/msg/Marker', points=[make('geometry_msgs/msg/Point', x=1.0)])
    assert (marker.text, marker.id, marker.pose.orientation.w, marker.points[0].x) == ('', 0, 1.0, 1.0)
    assert make(ODOMETRY).pose.covariance.shape == (36,)
    assert make('nav_msgs/msg/OccupancyGrid', data=[-1, 0, 100]).data.dtype == np.int8
    with pytest.raises(TypeError, match='has no field colour'):
        make('visualization_msgs/msg/Marker', colour=1)
