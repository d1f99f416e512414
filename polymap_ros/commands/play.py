"""polymap_play: publishes a recording's odometry and echoes, and /clock."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from polymap_ros.commands import console
from polymap_ros.commands.ros import refuse_ros_arguments, require_ros, without_ros_arguments
from polymap_ros.errors import RecordingError, UsageError

if TYPE_CHECKING:
    from polymap_ros.node.player import Player
    from polymap_ros.recordings.reading import Recording

PROGRAM = 'polymap_play'
WAIT_S = 60.0
QUICK_S, TELL_S = 1.0, 10.0
"""Who is found at once is not worth a line; where stderr is no terminal, lines come this far apart."""

FLUSH_S = 5.0
SLOWEST, FASTEST = 1e-6, 1e9
LAST_NS = 2**31 * 10**9
"""Where ROS's seconds end, and with them /clock."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    command_line = list(sys.argv[1:] if arguments is None else arguments)
    ours = without_ros_arguments(command_line)
    if status := console.attempt(PROGRAM, lambda: refuse_ros_arguments(ours, ('-r', '--remap'))):
        return status
    options = _parser().parse_args(ours)
    return console.execute(PROGRAM, lambda: _play(options, command_line))


def _parser() -> console.Parser:
    parser = console.Parser(
        PROGRAM, "Publish a recording's odometry as 'odom' and its echoes as 'echo', both reliable, and /clock.",
        'ROS arguments such as remaps follow --ros-args.',
        ['polymap_play drive.mcap', 'polymap_play bags/pentagon --rate 5 --loop',
         'polymap_play drive -p topics.echo:=/sonar/raw --ros-args -r echo:=/robot/echo'])
    parser.add_argument('recording', type=console.path_argument, metavar='RECORDING',
                        help='rosbag2 directory, or .mcap or .db3 file, compressed (.zstd) or not')
    parser.add_argument('--rate', type=float, default=1.0, metavar='R', help='speed, 2 is twice as fast (default: 1)')
    parser.add_argument('--loop', action='store_true', help='start again at the end, until Ctrl-C')
    parser.add_argument('--wait', type=float, default=WAIT_S, metavar='S',
                        help='wait at most this long for a subscriber to each of the two topics, then play to nobody; '
                             f'0: do not wait (default: {WAIT_S:g} s)')
    console.add_parameter_arguments(parser)
    return parser


def _play(options: argparse.Namespace, command_line: list[str]) -> int:
    if not SLOWEST <= options.rate <= FASTEST:
        raise UsageError(f'--rate {options.rate:g}; allowed: {SLOWEST:g} to {FASTEST:g}')
    if not options.wait >= 0.0:
        raise UsageError(f'--wait {options.wait:g}; allowed: at least 0 s')
    parameters = console.read_parameters(PROGRAM, options)
    require_ros()
    from polymap_ros.node.player import playing
    from polymap_ros.recordings.reading import Recording

    with Recording.open(options.recording) as recording:
        odom = recording.require(parameters.topics.odom, 'nav_msgs/msg/Odometry', 'topics.odom')
        echo = recording.require(parameters.topics.echo, parameters.echo.type, 'topics.echo')
        names = {odom: 'odom', echo: 'echo'}
        types = {'odom': 'nav_msgs/msg/Odometry', 'echo': parameters.echo.type}
        with playing(types, options.rate, command_line) as player:
            if options.wait:
                _wait(player, options.wait)
            count = 0
            while True:
                count += player.play(_renamed(recording, names))
                if not options.loop:
                    break
            player.flush(FLUSH_S)
            if not count and recording.faults:
                raise RecordingError(f'{options.recording}: no message can be read: {recording.faults[0]}')
    console.tell(f'{count} messages played')
    return console.DONE


def _wait(player: 'Player', wait_s: float) -> None:
    """Wait for subscribers, and show for which: on a terminal in one line, elsewhere in a line now and then."""
    told_s, terminal = -TELL_S, sys.stderr.isatty()

    def show(topics: list[str], waited_s: float) -> None:
        nonlocal told_s
        if waited_s < QUICK_S or waited_s - told_s < (1.0 if terminal else TELL_S):
            return
        told_s = waited_s
        text = f'waiting for a subscriber to {" and ".join(topics)}: {waited_s:.0f} s'
        if terminal:
            print(f'\r{PROGRAM}: {text}\x1b[K', end='', file=sys.stderr, flush=True)
        else:
            console.complain(PROGRAM, text)

    try:
        lonely = player.wait(wait_s, show)
    finally:
        if terminal and told_s >= 0.0:
            print(file=sys.stderr)
    if lonely:
        misfits = player.misfits(lonely)
        why = f'; the subscriber to {" and ".join(misfits)} wants another type or QoS' if misfits else ''
        console.complain(PROGRAM, f'nobody has subscribed to {" and ".join(lonely)} after {wait_s:g} s{why}: playing '
                                  'all the same (--wait S waits longer)')


def _renamed(recording: 'Recording', names: dict[str, str]) -> Iterator[tuple[str, str, Any, int]]:
    for topic, type_name, message, log_ns in recording.messages(names):
        if not 0 <= log_ns < LAST_NS:
            raise RecordingError(f'{recording.path}: a message on {topic} was logged at {log_ns * 1e-9:.9g} s, which '
                                 'is beyond /clock')
        yield names[topic], type_name, message, log_ns


if __name__ == '__main__':
    sys.exit(main())
