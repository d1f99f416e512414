"""`polymap_simulate`: a recording of a simulated scene, with its ground truth."""

import argparse
import io
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polymap_ros.commands import console

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from polymap_ros.simulation.scenes import Scene

PROGRAM = 'polymap_simulate'
ODOM_TOPIC, ECHO_TOPIC = '/odom', '/echo'
PULSE_NAME = 'pulse.npy'


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    arguments = _parser().parse_args(argv)
    return console.execute(PROGRAM, lambda: _simulate(arguments))


def _parser() -> console.Parser:
    parser = console.Parser(
        PROGRAM, 'Make a recording of a simulated scene, with its ground truth in truth.json and truth.tum.',
        'A scene file has the vertices and a path; copy a built-in one from the package, config/*.scene.yaml.',
        ['polymap_simulate pentagon --output drive', 'polymap_simulate plate.scene.yaml --output plate.mcap',
         'polymap_replay drive --plot --output polymap   # and map it'])
    parser.add_argument('scene', metavar='SCENE',
                        help='YAML scene file, or a built-in scene: triangle, quadrilateral, pentagon, rectangle')
    parser.add_argument('--output', type=console.path_argument, required=True, metavar='RECORDING',
                        help='rosbag2 directory to write, or a bare .mcap or .db3 file; must not exist')
    parser.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap',
                        help='format of a directory (default: mcap)')
    return parser


def _simulate(arguments: argparse.Namespace) -> int:
    from polymap_ros.simulation.scene_file import load_scene

    console.tell_compiling(PROGRAM)
    scene = load_scene(arguments.scene, recorded_path)
    record(scene, arguments.output, arguments.storage)
    console.tell(
        f'{console.in_one_line(arguments.output)}: {len(scene.vertices)} edges, {len(scene.poses)} pings of '
        f'{scene.n_samples} samples')
    return console.DONE


def record(scene: 'Scene', path: Path, storage: str = 'mcap') -> None:
    """Simulate a scene and write odometry, echoes, truth.json and, unless they are the default, params.yaml.

    A pulse that was read from a file is written too, for params.yaml to name.
    A ping is logged when its last sample is in. The odometry has a message at every emission and as many evenly
    in between as its rate asks for, and one before the first and after the last ping.
    """
    from polymap_ros.recordings.writing import RecordingWriter

    with RecordingWriter(path, storage, companions=_companions(scene)) as writer:
        entries = sorted([*_odometry(scene), *_echoes(scene)], key=lambda entry: entry[0])
        for log_ns, topic, message in entries:
            writer.write(topic, message, log_ns)


def _companions(scene: 'Scene') -> dict[str, bytes]:
    """What a replay needs to know of the scene, and the truth, by file."""
    import numpy as np

    from polymap_ros.recordings.truth import PATH_NAME, TRUTH_NAME
    from polymap_ros.results.tum import tum

    emissions_ns = scene.stamps_ns - round(scene.t0_s * 1e9)
    files = {TRUTH_NAME: (json.dumps(_truth(scene)) + '\n').encode(),
             PATH_NAME: tum(emissions_ns, scene.poses)}
    if scene.recorded_pulse is not None:
        pulse = io.BytesIO()
        np.save(pulse, scene.recorded_pulse, allow_pickle=False)
        files[PULSE_NAME] = pulse.getvalue()
    if text := _changed_parameters(scene):
        files['params.yaml'] = text.encode()
    return files


def _truth(scene: 'Scene') -> dict[str, Any]:
    """The walls; holes and inner walls where there are any."""
    from polymap_ros.simulation.inside import RoundHole

    truth: dict[str, Any] = {'vertices': scene.vertices.tolist()}
    if scene.holes:
        truth['holes'] = [{'vertices': hole.vertices.tolist()} | (
            {'centre': hole.centre.tolist(), 'radius_m': hole.radius_m} if isinstance(hole, RoundHole) else {})
            for hole in scene.holes]
    if scene.inner_walls:
        truth['inner_walls'] = [
            {'start': wall.start.tolist(), 'end': wall.end.tolist(), 'reflection': wall.reflection,
             'transmission': wall.transmission} for wall in scene.inner_walls]
    return truth


def recorded_path(path: Path, topic: str) -> 'NDArray[np.float64]':
    """Poses (N, 3) of an odometry topic of a recording."""
    import numpy as np

    from polymap_ros.geometry.plane import XY
    from polymap_ros.messages.odometry import stamped_pose
    from polymap_ros.recordings.reading import Recording

    with Recording.open(path) as recording:
        name = recording.require(topic, 'nav_msgs/msg/Odometry', 'topics.odom')
        poses = [XY.place(stamped_pose(entry.message)[2]).pose for entry in recording.messages([name])]
    return np.array([(pose.x, pose.y, pose.yaw) for pose in poses])


def _odometry(scene: 'Scene') -> Iterator[tuple[int, str, Any]]:
    import numpy as np

    from polymap_ros.geometry.pose import Pose
    from polymap_ros.messages.outputs import odometry_message
    from polymap_ros.recordings.writing import make

    emissions = scene.stamps_ns - round(scene.t0_s * 1e9)
    period_ns = round(scene.ping_period_s * 1e9)
    parts = max(1, int(np.ceil(scene.ping_period_s * scene.odometry_rate_hz)))
    poses = scene.reported_poses()
    poses[:, 2] = np.unwrap(poses[:, 2])
    known = np.concatenate(([emissions[0] - period_ns], emissions, [emissions[-1] + period_ns]))
    known_poses = np.vstack((poses[:1], poses, poses[-1:]))
    steps = np.arange((len(known) - 1) * parts + 1) / parts
    stamps = known[0] + np.rint(steps * period_ns).astype(np.int64)
    columns = [np.interp(steps, np.arange(len(known)), column) for column in known_poses.T]
    for stamp, *pose in zip(stamps.tolist(), *columns, strict=True):
        yield stamp, ODOM_TOPIC, odometry_message(make, stamp, 'odom', Pose(*pose))


def _echoes(scene: 'Scene') -> Iterator[tuple[int, str, Any]]:
    from polymap_ros.messages.outputs import echo_message
    from polymap_ros.recordings.writing import make
    from polymap_ros.simulation.waveforms import pings

    window_ns = round(scene.n_samples * scene.period_s * 1e9)
    for ping in pings(scene):
        yield ping.stamp_ns + window_ns, ECHO_TOPIC, echo_message(make, ping, scene.ping_period_s)


def _changed_parameters(scene: 'Scene') -> str:
    """The mapper's parameters for this scene as a ROS parameter file, as far as they differ from the defaults."""
    import yaml

    from polymap_ros.parameters import NODE_NAME, Parameters

    defaults = Parameters().flat()
    changed = {name: value for name, value in scene.parameters().flat().items() if value != defaults[name]}
    if 'pulse.path' in changed:
        changed['pulse.path'] = PULSE_NAME
    return yaml.safe_dump({NODE_NAME: {'ros__parameters': changed}}) if changed else ''


if __name__ == '__main__':
    sys.exit(main())
