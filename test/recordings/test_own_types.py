"""Echoes of other people's message types, from the definitions that a recording carries."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.signal import hilbert

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import ParameterError, RecordingError
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.outputs import odometry_message
from polymap_ros.parameters import Parameters
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.replay import Replay
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

SONAR_ECHO, RAW_IMAGE = 'ping360_sonar_msgs/msg/SonarEcho', 'marine_acoustic_msgs/msg/RawSonarImage'

# Fields as in CentraleNantesRobotics/ping360_sonar (ROS 2) and apl-ocean-engineering/marine_msgs (marine_acoustic_msgs
# of Jazzy), without their comments.
DEFINITIONS = {
    SONAR_ECHO: """
std_msgs/Header header
float32 angle
uint8 gain
uint16 number_of_samples
uint16 transmit_frequency
uint16 speed_of_sound
uint8 range
uint8[] intensities
""",
    'marine_acoustic_msgs/msg/PingInfo': """
float32 frequency
float32 sound_speed
float32[] tx_beamwidths
float32[] rx_beamwidths
""",
    'marine_acoustic_msgs/msg/SonarImageData': """
uint32 DTYPE_UINT8=0
uint32 DTYPE_INT16=3
uint32 DTYPE_FLOAT32=8
bool is_bigendian
uint32 dtype
uint32 beam_count
uint8[] data
""",
    RAW_IMAGE: """
std_msgs/Header header
PingInfo ping_info
float32 sample_rate
uint32 samples_per_beam
uint32 sample0
float32[] tx_delays
float32[] tx_angles
float32[] rx_angles
SonarImageData image
""",
}
MEDIUM = {'medium.model': 'constant', 'medium.speed_m_s': 1500.0}


@pytest.fixture(scope='module')
def store():
    types = get_typestore(Stores.ROS2_JAZZY)
    for name, text in DEFINITIONS.items():
        types.register(get_types_from_msg(text, name))
    return types


@pytest.fixture(scope='module')
def scene():
    return load_scene('triangle', None)


@pytest.fixture(scope='module')
def counts(scene):
    """The triangle's samples as 16 bit counts."""
    samples = simulate(scene)
    return np.round(samples / abs(samples).max() * 32767.0).astype(np.int16)


@pytest.fixture
def record(store, scene, tmp_path):
    """Write the scene's odometry, and a message of `echo_of(k, header)` at every pose."""

    def make(type_name, /, **fields):
        return store.types[type_name](**fields)

    def write(type_name, echo_of, storage=StoragePlugin.MCAP):
        path = tmp_path / 'run'
        with Writer(path, version=9, storage_plugin=storage) as writer:
            odometry = writer.add_connection('/odom', 'nav_msgs/msg/Odometry', typestore=store)
            echoes = writer.add_connection('/sonar', type_name, typestore=store)
            for k, (stamp_ns, pose) in enumerate(zip(scene.stamps_ns.tolist(), scene.poses.tolist(), strict=True)):
                message = odometry_message(make, stamp_ns, 'odom', Pose(*pose))
                writer.write(odometry, stamp_ns, store.serialize_cdr(message, 'nav_msgs/msg/Odometry'))
                stamp = make('builtin_interfaces/msg/Time', sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
                message = echo_of(make, k, make('std_msgs/msg/Header', stamp=stamp, frame_id='sonar'))
                writer.write(echoes, stamp_ns, store.serialize_cdr(message, type_name))
        return path

    return write


def raw_image(counts, code='>i2', dtype=3, beams=1, big=True):
    def echo_of(make, k, header):
        info = make('marine_acoustic_msgs/msg/PingInfo', frequency=1e5, sound_speed=1500.0,
                    tx_beamwidths=np.empty(0, np.float32), rx_beamwidths=np.empty(0, np.float32))
        data = np.frombuffer(counts[k].astype(code).tobytes(), np.uint8)
        image = make('marine_acoustic_msgs/msg/SonarImageData', DTYPE_UINT8=0, DTYPE_INT16=3, DTYPE_FLOAT32=8,
                     is_bigendian=big, dtype=dtype, beam_count=beams, data=data)
        zero = np.zeros(1, np.float32)
        return make(RAW_IMAGE, header=header, ping_info=info, sample_rate=1e6, samples_per_beam=len(counts[k]),
                    sample0=0, tx_delays=zero, tx_angles=zero, rx_angles=zero, image=image)
    return echo_of


def replayed(path, parameters):
    mapper = PolygonMapper(parameters)
    with Recording.open(path) as recording:
        for _ in Replay(recording, mapper, parameters):
            pass
    return mapper


def parameters_of(scene, type_name, samples_field, **rest):
    return scene.parameters(Parameters()).replaced({
        'echo.type': type_name, 'echo.samples_field': samples_field, 'echo.sample_period_s': 1e-6,
        'topics.echo': 'sonar', 'solver.method': 'paper', **{name.replace('__', '.'): v for name, v in rest.items()}})


def by_hand(scene, samples, parameters):
    mapper = PolygonMapper(parameters)
    for stamp_ns, pose, row in zip(scene.stamps_ns.tolist(), scene.poses.tolist(), samples, strict=True):
        mapper.add_pose(stamp_ns, Pose(*pose))
        mapper.add_ping(Ping(stamp_ns, row.astype(np.float32), 1e-6))
    return mapper


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_raw_sonar_images_give_the_map_of_their_samples(record, scene, counts, storage):
    """RawSonarImage, 16 bit, big-endian, as it says itself."""
    parameters = parameters_of(scene, RAW_IMAGE, 'image.data')
    mapper = replayed(record(RAW_IMAGE, raw_image(counts), storage), parameters)
    expected = by_hand(scene, counts, parameters)
    assert mapper.counts.used == len(counts)
    assert expected.counts.used == len(counts)
    # Odometry went through quaternions.
    np.testing.assert_allclose(mapper.beam_map.values, expected.beam_map.values, rtol=1e-4, atol=1e-3)
    assert len(mapper.solve().polygon.vertices) == 3


def test_float_images_and_those_of_the_other_byte_order(record, scene, counts):
    parameters = parameters_of(scene, RAW_IMAGE, 'image.data')
    floats = replayed(record(RAW_IMAGE, raw_image(counts, '<f4', dtype=8, big=False)), parameters)
    expected = by_hand(scene, counts, parameters)
    np.testing.assert_allclose(floats.beam_map.values, expected.beam_map.values, rtol=1e-4, atol=1e-3)


def test_more_than_one_beam_is_dropped_and_said(record, scene, counts):
    mapper = replayed(record(RAW_IMAGE, raw_image(counts, beams=2)), parameters_of(scene, RAW_IMAGE, 'image.data'))
    assert mapper.counts.dropped == {'bad_shape': len(counts)}
    assert mapper.intake.last_drop_texts['bad_shape'] == 'image.data holds 2 beams; an A-scan is one'


def test_sonar_echoes_are_counts_of_a_magnitude(record, scene):
    """SonarEcho of a Ping360: 8 bit magnitudes in water, mapped as `echo.kind: envelope`."""
    envelopes = abs(hilbert(simulate(scene), axis=1))
    levels = np.round(255.0 * envelopes / envelopes.max()).astype(np.uint8)

    def echo_of(make, k, header):
        return make(SONAR_ECHO, header=header, angle=0.0, gain=1, number_of_samples=levels.shape[1],
                    transmit_frequency=740, speed_of_sound=1500, range=2, intensities=levels[k])

    parameters = parameters_of(scene, SONAR_ECHO, 'intensities', echo__kind='envelope').replaced(MEDIUM)
    mapper = replayed(record(SONAR_ECHO, echo_of), parameters)
    expected = by_hand(scene, levels, parameters)
    assert mapper.counts.used == expected.counts.used == len(levels)
    np.testing.assert_allclose(mapper.beam_map.values, expected.beam_map.values, rtol=1e-4, atol=1e-3)
    assert mapper.soundings[0].rho == pytest.approx(expected.soundings[0].rho)


@pytest.mark.parametrize(('fields', 'says'), [
    ({'samples_field': 'image.pixels'}, "SonarImageData has no field 'pixels', only is_bigendian, dtype, beam_count, "
                                        'data'),
    ({'samples_field': 'sample_rate'}, 'is float32; arrays of numbers there: ping_info.tx_beamwidths, '
                                       'ping_info.rx_beamwidths, tx_delays, tx_angles, rx_angles, image.data'),
    ({'samples_field': 'image.data', 'echo__stamp_field': 'stamp'}, "has no field 'stamp', only header, ping_info"),
])
def test_a_field_that_is_not_there_is_refused_before_anything_is_read(record, scene, counts, fields, says):
    with pytest.raises(ParameterError) as refused:
        replayed(record(RAW_IMAGE, raw_image(counts)), parameters_of(scene, RAW_IMAGE, **fields))
    assert says in str(refused.value)


def test_another_type_than_the_recorded_is_refused_with_the_recorded(record, scene, counts):
    with pytest.raises(RecordingError, match=f'topic /sonar is of type {RAW_IMAGE}, not {SONAR_ECHO}'):
        replayed(record(RAW_IMAGE, raw_image(counts)), parameters_of(scene, SONAR_ECHO, 'intensities'))
