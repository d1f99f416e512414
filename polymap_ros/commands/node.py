"""polymap_node: the live mapping node."""

import argparse
import signal
import sys
from collections.abc import Sequence

from polymap_ros.commands import console
from polymap_ros.commands.ros import require_ros, without_ros_arguments

PROGRAM = 'polymap_node'
EPILOG = """Parameters, remaps and the like are ROS's own, for example:
polymap_node --ros-args --params-file polymap.yaml -p echo.type:=sensor_msgs/msg/Image -r echo:=/sonar/raw"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status, 0 after Ctrl-C or SIGTERM."""
    console.one_core()  # a second thread of the linear algebra makes no solve faster, and the messages wait for it
    command_line = list(sys.argv[1:] if arguments is None else arguments)
    parser = console.Parser(PROGRAM, 'Maps the polygon around a robot from echoes and odometry, live.', EPILOG)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.parse_args(without_ros_arguments(command_line))
    return console.attempt(PROGRAM, lambda: _run(command_line))


def _run(command_line: list[str]) -> int:
    require_ros()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # until rclpy takes over
    try:
        from polymap_ros.node.running import run

        run(command_line)
    except KeyboardInterrupt:
        console.complain(PROGRAM, 'interrupted while starting')
    return console.DONE


if __name__ == '__main__':
    sys.exit(main())
