"""Fuzzing of what comes from outside: python test/fuzz.py TARGET [CORPUS...] [options of libFuzzer].

Needs the extra `fuzz` (CPython 3.11); -max_total_time=600 ends it after ten minutes, else it ends with the input that
raises what the callers do not expect.
"""

import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import atheris

from polymap_ros.mapping.mapper import PolygonMapper  # before: what is compiled must not be instrumented

with atheris.instrument_imports(include=[f'polymap_ros.{name}' for name in (
        'messages', 'recordings', 'results.arrays', 'parameter_file', 'plain_yaml')]):
    from polymap_ros.messages.echoes import ping_from_message
    from polymap_ros.messages.odometry import stamped_pose
    from polymap_ros.parameter_file import load_parameters
    from polymap_ros.recordings.reading import Recording
    from polymap_ros.results.arrays import npz, read_state, state_npz

import numpy as np

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import BadOdometry, BadPing, ParameterError, RecordingError, StateError, UsageError
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, odometry_message
from polymap_ros.parameters import Parameters, specifications
from polymap_ros.recordings.writing import RecordingWriter, make, typestore

FOLDER = Path(tempfile.mkdtemp(prefix='polymap_fuzz_', dir='/dev/shm' if os.path.isdir('/dev/shm') else None))  # noqa: PTH112
SMALL = Parameters().replaced({
    'medium.model': 'constant', 'grid.range_max_m': 0.2, 'grid.range_step_m': 0.02, 'grid.angle_step_deg': 90.0,
    'pulse.frequency_hz': 20e3, 'echo.blanking_m': 0.0, 'solver.method': 'rectangle'})
OWN = 'sensor_msgs/msg/CompressedImage'
ECHOES = {
    'sensor_msgs/msg/LaserScan': {}, 'sensor_msgs/msg/PointCloud2': {},
    'sensor_msgs/msg/Image': {'echo.sample_period_s': 1e-6},
    'std_msgs/msg/Float32MultiArray': {'echo.sample_period_s': 1e-6, 'echo.allow_unstamped': True},
    OWN: {'echo.sample_period_s': 1e-6, 'echo.samples_field': 'data', 'echo.samples_dtype': 'int16'},
}
GIVEN = {name: SMALL.replaced({'echo.type': name, **values}) for name, values in ECHOES.items()}


def samples(n=64):
    return np.sin(np.arange(n)).astype(np.float32)


def example_messages():
    """One sound message of every type that is read."""
    header = make('std_msgs/msg/Header', stamp=make('builtin_interfaces/msg/Time', sec=1), frame_id='sonar')
    values = samples()
    fields = [make('sensor_msgs/msg/PointField', name='amplitude', offset=0, datatype=7, count=1),
              make('sensor_msgs/msg/PointField', name='t', offset=4, datatype=7, count=1)]
    cloud = np.column_stack((values, 1e-6 * np.arange(64))).astype(np.float32).view(np.uint8).ravel()
    return [
        odometry_message(make, 10**9, 'odom', Pose(0.1, 0.2, 0.3)), echo_message(make, Ping(10**9, values, 1e-6)),
        make('sensor_msgs/msg/PointCloud2', header=header, height=1, width=64, fields=fields, point_step=8,
             row_step=512, data=cloud),
        make('sensor_msgs/msg/Image', header=header, height=1, width=64, encoding='32FC1', step=256,
             data=values.view(np.uint8)),
        make('std_msgs/msg/Float32MultiArray', data=values), make(OWN, header=header, data=values.view(np.uint8)),
    ]


TYPES = [message.__msgtype__ for message in example_messages()]


def messages(data):
    """The first byte says which type the rest is, as CDR."""
    if not data:
        return
    name = TYPES[data[0] % len(TYPES)]
    try:
        message = typestore().deserialize_cdr(data[1:], name)
    except Exception:  # as `Recording.messages` does
        return
    with suppress(BadPing, BadOdometry):
        if name == TYPES[0]:
            stamped_pose(message)
            return
        mapper = PolygonMapper(GIVEN[name])
        mapper.add_pose(0, Pose(0.0, 0.0))
        mapper.add_pose(2 * 10**9 - 1, Pose(0.01, 0.0))
        mapper.add_ping(ping_from_message(message, name, GIVEN[name].echo, 10**9))
        mapper.finish()
        counts = mapper.counts
        assert counts.received == counts.used + sum(counts.dropped.values()) == 1


def recording(data):
    """The first byte says whether the rest is an .mcap or a .db3."""
    path = FOLDER / ('run.mcap' if data[:1] < b'\x80' else 'run.db3')
    path.write_bytes(data[1:])
    with suppress(RecordingError), Recording.open(path) as found:
        for entry in found.messages():
            assert entry.topic in found.topics
        assert all(caution.text for caution in found.cautions(list(found.topics)))


def parameters(data):
    path = FOLDER / 'parameters.yaml'
    path.write_bytes(data)
    with suppress(ParameterError, UsageError):
        load_parameters(path)


def state(data):
    """A state.npz as it is, or with what the first byte names replaced by the rest, and its checksum right."""
    path = FOLDER / 'state.npz'
    arrays = dict(STATE)
    path.write_bytes(data)
    if data[:1] < b'\x80' and len(data) > 2:
        name = list(arrays)[data[0] % len(arrays)]
        arrays[name] = changed(arrays[name], data[1], data[2:])
        path.write_bytes(state_npz(arrays))
    with suppress(StateError):
        mapper = PolygonMapper.from_state(SMALL, read_state(path))
        feed(mapper, 8, 12)
        mapper.solve()
        mapper.state()


def changed(array, how, rest):
    """Another array of the same type, with other bytes, or another shape."""
    size = max(array.dtype.itemsize, 1)
    content = (rest if how % 2 else rest + array.tobytes()[len(rest):])[:4096 * size]
    flat = np.frombuffer(content[:len(content) // size * size], array.dtype)
    return flat.reshape(array.shape) if flat.size == array.size else flat.reshape((-1, *array.shape[1:]) if (
        array.ndim > 1 and flat.size % max(int(np.prod(array.shape[1:])), 1) == 0 and flat.size) else -1)


def feed(mapper, first, last):
    for k in range(first, last):
        mapper.add_pose(k * 10**8, Pose(0.01 * k, 0.001 * k * k, 0.1 * k))
        mapper.add_ping(Ping(k * 10**8 + 1, samples(128) * (1 + k), 1e-5))


def example_state():
    mapper = PolygonMapper(SMALL)
    feed(mapper, 0, 8)
    return mapper.state()


def seeds(target):
    """Sound inputs to begin with."""
    if target is messages:
        return [bytes([k]) + bytes(typestore().serialize_cdr(message, message.__msgtype__))
                for k, message in enumerate(example_messages())]
    if target is recording:
        return [first + written(suffix) for first, suffix in ((b'\x00', '.mcap'), (b'\x80', '.db3'))]
    if target is parameters:
        config = Path(__file__).parents[1] / 'polymap_ros' / 'config' / 'polymap.yaml'
        return [config.read_bytes(), *(f'/**: {{ros__parameters: {{{spec.name}: {spec.default}}}}}'.encode()
                                       for spec in specifications())]
    return [b'\x80' + state_npz(STATE), npz({'format': np.array(1)}),
            *(bytes([k, 0]) + array.tobytes()[:64] for k, array in enumerate(STATE.values()))]


def written(suffix):
    path = FOLDER / f'seed{suffix}'
    with RecordingWriter(path) as writer:
        for k, message in enumerate(example_messages()):
            writer.write(f'/topic{k}', message, k)
    return path.read_bytes()


def main():
    targets = {each.__name__: each for each in (messages, recording, parameters, state)}
    if len(sys.argv) < 2 or sys.argv[1] not in targets:
        sys.exit(f'{__doc__}\nTargets: {", ".join(targets)}')
    target = targets[sys.argv.pop(1)]
    begin = FOLDER / 'seeds'
    begin.mkdir()
    for k, content in enumerate(seeds(target)):
        (begin / str(k)).write_bytes(content)
    atheris.Setup([*sys.argv, str(begin)], target)
    atheris.Fuzz()


STATE = example_state()

if __name__ == '__main__':
    main()
