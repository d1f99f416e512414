"""polymap_play: publishes a recording's odometry and echoes, and /clock."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polymap_ros.commands import console
from polymap_ros.commands.ros import require_ros, without_ros_arguments
from polymap_ros.errors import RecordingError, UsageError

if TYPE_CHECKING:
    from polymap_ros.recordings.reading import Recording

PROGRAM = 'polymap_play'
WAIT_S = 5.0
FLUSH_S = 5.0
SLOWEST, FASTEST = 1e-6, 1e9
LAST_NS = 2**31 * 10**9
"""Where ROS's seconds end, and with them /clock."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    command_line = list(sys.argv[1:] if arguments is None else arguments)
    options = _parser().parse_args(without_ros_arguments(command_line))
    return console.execute(PROGRAM, lambda: _play(options, command_line))


def _parser() -> console.Parser:
    parser = console.Parser(
        PROGRAM, "Publishes a recording's odometry as 'odom' and its echoes as 'echo', both reliable, and /clock.",
        'ROS arguments such as remaps follow --ros-args.')
    parser.add_argument('recording', type=Path, metavar='RECORDING', help='rosbag2 directory, or .mcap or .db3 file')
    parser.add_argument('--rate', type=float, default=1.0, metavar='R', help='speed, 2 is twice as fast (default: 1)')
    parser.add_argument('--loop', action='store_true', help='start again at the end, until Ctrl-C')
    parser.add_argument('--wait', type=float, default=WAIT_S, metavar='S',
                        help=f'wait for subscribers at most this long before the start (default: {WAIT_S:g} s)')
    console.add_parameter_arguments(parser)
    return parser


def _play(options: argparse.Namespace, command_line: list[str]) -> int:
    if not SLOWEST <= options.rate <= FASTEST:
        raise UsageError(f'--rate {options.rate:g}; allowed: {SLOWEST:g} to {FASTEST:g}')
    parameters = console.read_parameters(options)
    require_ros()
    from polymap_ros.node.player import playing
    from polymap_ros.recordings.reading import Recording

    with Recording.open(options.recording) as recording:
        odom = recording.require(parameters.topics.odom, 'nav_msgs/msg/Odometry', 'topics.odom')
        echo = recording.require(parameters.topics.echo, parameters.echo.type, 'topics.echo')
        names = {odom: 'odom', echo: 'echo'}
        types = {'odom': 'nav_msgs/msg/Odometry', 'echo': parameters.echo.type}
        with playing(types, options.rate, command_line) as player:
            if lonely := player.wait(options.wait):
                console.complain(PROGRAM, f'nobody subscribes to {" and ".join(lonely)} yet; playing nevertheless')
            count = 0
            while True:
                count += player.play(_renamed(recording, names))
                if not options.loop:
                    break
            player.flush(FLUSH_S)
    console.tell(f'{count} messages played')
    return console.DONE


def _renamed(recording: 'Recording', names: dict[str, str]) -> Iterator[tuple[str, str, Any, int]]:
    for topic, type_name, message, log_ns in recording.messages(names):
        if not 0 <= log_ns < LAST_NS:
            raise RecordingError(f'{recording.path}: a message on {topic} was logged at {log_ns * 1e-9:.9g} s, which '
                                 'is beyond /clock')
        yield names[topic], type_name, message, log_ns


if __name__ == '__main__':
    sys.exit(main())
