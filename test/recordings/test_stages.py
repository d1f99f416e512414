"""What keeps a recording from being mapped is told by the first stage that failed, and with its own remedy."""

import dataclasses
import sqlite3
from contextlib import closing

import numpy as np
import pytest
from damage import raw_messages, write_mcap

from polymap_ros.acoustics.pulse import RecordedPulse
from polymap_ros.cautions import causes
from polymap_ros.errors import RecordingError
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.replay import Replay
from polymap_ros.recordings.writing import RecordingWriter, make

PARAMETERS = Parameters().replaced({'solver.method': 'rectangle', 'grid.range_max_m': 0.3})


@pytest.fixture
def altered(write_recording, tmp_path):
    """Rewrite a recording: `change(topic, message)` gives what is written in the place of each message."""

    def rewrite(change):
        with Recording.open(write_recording('sound')) as source, RecordingWriter(tmp_path / 'altered') as writer:
            for entry in source.messages():
                writer.write(entry.topic, change(entry.topic, entry.message), entry.log_ns)
        return tmp_path / 'altered'

    return rewrite


def stamped(message, ns):
    stamp = make('builtin_interfaces/msg/Time', sec=ns // 10**9, nanosec=ns % 10**9)
    return dataclasses.replace(message, header=dataclasses.replace(message.header, stamp=stamp))


def told(path, parameters=PARAMETERS, pulse=None):
    """Findings and remedies of what keeps the recording from being mapped."""
    mapper = PolygonMapper(parameters, pulse)
    with Recording.open(path) as recording:
        replay = Replay(recording, mapper, parameters)
        for _ in replay:
            pass
        cautions = replay.cautions()
    found = causes([*mapper.solve().cautions, *cautions])
    text = '; '.join(caution.text for caution in found)
    assert 'drive a' not in text
    assert 'go on pinging' not in text
    return text


def test_odometry_that_nobody_stamped(altered):
    path = altered(lambda topic, message: stamped(message, 0) if topic == '/odom' else message)
    with pytest.raises(RecordingError, match=r'stamps of /odom are all 0, .*its driver does not fill header\.stamp'):
        told(path)


def test_echoes_that_nobody_stamped(altered):
    text = told(altered(lambda topic, message: stamped(message, 0) if topic == '/echo' else message))
    assert text.startswith('all pings were dropped, most as duplicate: ')
    assert 'stamps are all 0' in text


def test_echoes_of_another_clock(altered):
    def change(topic, message):
        return stamped(message, 10**15 + message.header.stamp.nanosec) if topic == '/echo' else message

    text = told(altered(change))
    assert text.startswith('all pings were dropped, most as no_pose: the echo is stamped 1000000.')
    assert text.endswith('that is another clock; both are to be stamped by one; record odometry for as long as pings, '
                         'stamped by the same clock')


@pytest.mark.parametrize(('values', 'pulse', 'remedy'), [
    ({}, RecordedPulse([0.0, 1.0, -1.0, 0.0], 3e-6), "Hz; resample the pulse to the echoes' rate"),
    ({'front_end.gain_db_s': 1e7}, None, 'set front_end.gain_db_s to what the device does'),
    ({'pulse.frequency_hz': 6e5}, None, 'echo.sample_period_s, and pulse.frequency_hz'),
])
def test_a_parameter_that_drops_pings_has_its_own_remedy(write_recording, values, pulse, remedy):
    text = told(write_recording('sound'), PARAMETERS.replaced(values), pulse)
    assert text.count(remedy) == 1
    assert 'mend that where the echoes are recorded' not in text


def test_echoes_whose_clock_is_ahead_by_less_than_the_recording_is_long(altered):
    """Enough pings are left for an answer, which is of wrong places: the dropped ones come before it."""
    def change(topic, message):
        if topic != '/echo':
            return message
        return stamped(message, message.header.stamp.sec * 10**9 + message.header.stamp.nanosec + 8 * 10**8)

    text = told(altered(change))
    assert ' of 20 pings were dropped, most as no_pose: ' in text.partition(';')[0]
    assert text.startswith(('7', '8', '9'))
    assert 'stamped by the same clock' in text.split('; ')[1]


@pytest.mark.parametrize(('offset_s', 'words'), [
    (18, 'the echoes are stamped 118.050 to 119.950 s, the odometry 100.000 to 102.000 s'),
    (-60, 'the echoes are stamped 40.050 to 41.950 s, the odometry 100.000 to 102.000 s'),
    (600, 'the echoes are stamped 700.050 to 701.950 s, the odometry 100.000 to 102.000 s'),
    (3600, 'that is another clock'), (3599, 'that is another clock')])
def test_echoes_of_a_clock_that_is_off_by_seconds_or_an_hour(altered, offset_s, words):
    def change(topic, message):
        stamp = message.header.stamp
        return stamped(message, (stamp.sec + offset_s) * 10**9 + stamp.nanosec) if topic == '/echo' else message

    text = told(altered(change))
    assert text.startswith('all pings were dropped, most as ')
    assert (words in text, 'stamped by the same clock' in text) == (True, True)


def test_echoes_whose_period_is_in_microseconds(altered):
    def change(topic, message):
        return dataclasses.replace(message, time_increment=1.0) if topic == '/echo' else message

    assert '1 looks like microseconds' in told(altered(change))


def test_odometry_of_which_one_message_is_a_pose_is_blamed_for_pings_without_one(altered):
    taken = []

    def change(topic, message):
        if topic == '/odom':
            taken.append(message)
            if len(taken) != 20:
                message.pose.pose.orientation.w = np.nan
        return message

    text = told(altered(change))
    assert text.startswith('19 of 20 pings were dropped, most as no_pose: no odometry came after it; /odom: of 41 '
                           'messages dropped: 40 bad_pose; ')


def test_echoes_that_are_no_cdr(write_recording):
    path = write_recording('run.db3')
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("UPDATE messages SET data = CAST('{\"a\": 1}' AS BLOB) WHERE topic_id = 2")
    assert ("most as bad_shape: /echo: the message cannot be decoded: the first begins with '{\"a\": 1}', CDR with a "
            'byte 00') in told(path)


def test_odometry_that_is_no_cdr(write_recording, tmp_path):
    messages = [(topic, kind, ns, b'{"pose": 1}' if topic == '/odom' else raw)
                for topic, kind, ns, raw in raw_messages(write_recording())]
    with pytest.raises(RecordingError) as caught:
        told(write_mcap(tmp_path / 'json.mcap', messages))
    assert 'unit quaternion' not in str(caught.value)
    assert "they cannot be decoded: the first begins with '{\"pose\":', CDR with a byte 00" in str(caught.value)
