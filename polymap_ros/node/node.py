"""The live mapping node: a thin leaf over `PolygonMapper`."""

import time
from collections.abc import Sequence
from typing import Any

from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from polymap_ros.errors import BadOdometry, BadPing, UsageError
from polymap_ros.geometry.plane import SpatialPose
from polymap_ros.jit import when_compiling
from polymap_ros.messages.echoes import ping_from_message
from polymap_ros.messages.fields import check_echo_fields
from polymap_ros.messages.odometry import stamped_pose
from polymap_ros.node.background import Background
from polymap_ros.node.declaration import LiveParameters, declare
from polymap_ros.node.diagnostics import Diagnosed, Diagnostics
from polymap_ros.node.factory import fields_of
from polymap_ros.node.initial_pose import InitialPose
from polymap_ros.node.inputs import Input
from polymap_ros.node.latency import Latency
from polymap_ros.node.later import Later
from polymap_ros.node.map_frame import MapFrame
from polymap_ros.node.publishers import Outputs
from polymap_ros.node.saving import Saver
from polymap_ros.node.sensor_frame import SensorFrame
from polymap_ros.node.solving import SolveLoop
from polymap_ros.node.starting import Starting
from polymap_ros.node.stopwatch import Stopwatch
from polymap_ros.parameters import NODE_NAME, Parameters
from polymap_ros.pulse_file import read_pulse
from polymap_ros.results.loading import loaded_mapper

CHORES_S = 1.0
HEARTBEAT_S = 10.0
PINGS_AT_ONCE = 2
"""Pings that have waited are used so many at a time, so that what comes meanwhile does not wait for all of them."""

CATCH_UP_S = 0.01
"""Pause before the first of them that a message left."""


class PolymapNode(Node):  # type: ignore[misc]
    """Subscribes to odometry and echoes, maps, solves and publishes.

    Parameters
    ----------
    arguments : sequence of str
        The command line.

    Raises
    ------
    UsageError
        Where both inputs are one topic.
    ParameterError
        For parameters that are not allowed.
    StateError
        For a saved state that cannot be continued, or a map in which no robot can be localised.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        super().__init__(NODE_NAME, automatically_declare_parameters_from_overrides=True)
        parameters = declare(self, arguments)
        check_echo_fields(parameters.echo, fields_of)
        self._log_parameters(parameters)
        pulse = read_pulse(parameters)
        self._stopwatch = Stopwatch()
        self._later = Later(self, self._stopwatch)
        self._background = Background(self._later, self._go_on)
        self._mapper = loaded_mapper(parameters, pulse, self._background, PINGS_AT_ONCE)
        self._sensor_frame = SensorFrame(self) if parameters.sensor.from_tf else None
        if self._sensor_frame is not None:
            self._mapper.intake.locate = self._sensor_frame
        self._latency = Latency()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._live = LiveParameters(self, parameters, self._apply)
        watch = self._stopwatch
        self._map_frame = MapFrame(self, self._mapper, steady, watch)
        self._mapper.placed = self._placed
        self._outputs = Outputs(self, self._mapper, self._later, lambda: self._live.current)
        self._solving = SolveLoop(
            self, self._mapper, steady, self._later, watch, self._outputs.drawn, self._show)
        self._solving.set_period(parameters.solver.period_s)
        self._saver = Saver(self, self._mapper, lambda: self._live.current, watch)
        self._mapper.intake.held = True
        self._watch_clock()
        if self.resolve_topic_name('odom') == (echo := self.resolve_topic_name('echo')):
            raise UsageError(f'odom and echo are both remapped to {echo}, and a topic has one type')
        self._odometry = Input(self, 'odom', 'nav_msgs/msg/Odometry', self._take_odometry, watch)
        self._echoes = Input(self, 'echo', parameters.echo.type, self._take_echo, watch)
        self._initial_pose = InitialPose(self, self._mapper) if parameters.localises else None
        self._start = Starting(self, parameters, pulse, self._later, self._go)
        parts = Diagnosed(self._odometry, self._echoes, self._mapper, self._latency, self._solving, self._saver, watch,
                      self._start)
        self._diagnostics = Diagnostics(self, parts)
        self._chores_done = 0
        self._back: tuple[int, str, SpatialPose] | None = None  # odometry that alone says that time went back
        self.create_timer(CHORES_S, self._do_chores, clock=steady)
        self._catch_up = self.create_timer(CATCH_UP_S, watch.timed('catching up', self._go_on), clock=steady)
        self._catch_up.cancel()
        self._offer_services()
        self._later('diagnostics', self._diagnostics.publish)
        self._start.begin()

    def reset(self) -> None:
        """Forget the map and clear what is latched."""
        frame_id = self._mapper.frame_id
        self._mapper.reset()
        self._solving.drop()
        self._saver.begin_anew()
        self._diagnostics.begin_anew()
        self._map_frame.reset()
        self._outputs.clear(self._mapper.map_frame or frame_id)

    def _placed(self, stamp_ns: int) -> None:
        """A ping has its place in the map."""
        self._latency.placed(stamp_ns)
        self._map_frame.update()

    def _show(self, messages: Sequence[Any]) -> None:
        """A solve has ended."""
        self._map_frame.update()
        self._outputs.publish(messages)

    def _go(self) -> None:
        """All kernels are ready: use what has come meanwhile."""
        self._mapper.intake.held = False
        self._go_on()
        self.get_logger().info(f'ready: odometry on {self._odometry.topic}, echoes on {self._echoes.topic}')

    @property
    def answering(self) -> bool:
        """Whether a client waits for a save."""
        return self._saver.answering

    def close(self) -> None:
        """Drop what is being solved and finish what is being written; to be called after the last callback."""
        self._start.close()
        self._solving.close()
        self._background.close()
        self._saver.close()

    def _take_odometry(self, message: Any, received_ns: int) -> None:
        try:
            stamp_ns, frame_id, pose = stamped_pose(message)
        except BadOdometry as error:
            self._refuse(str(error))
            return
        if self._sensor_frame is not None:
            self._sensor_frame.base = message.child_frame_id
        back_s = self._behind_s(stamp_ns)
        is_back = back_s > self._live.current.odometry.max_gap_s and frame_id == self._mapper.frame_id
        first, self._back = self._back, None
        if is_back and self._mapper.intake.resuming:
            self.get_logger().warning(f'odometry begins {back_s:.3f} s before the loaded map ends: the map is kept and '
                                      'goes on under another clock (odometry.on_jump_back)')
        elif is_back and first is not None and stamp_ns > first[0]:
            self._jumped_back(f'odometry went back by {self._behind_s(first[0]):.3f} s')
            self._add_pose(*first)
        else:
            if first is not None:
                self._refuse(f'one message was stamped {self._behind_s(first[0]):.3f} s before the newest, alone')
            if is_back:  # a single wild stamp loses no map: the next one has to confirm that time began anew
                self._back = stamp_ns, frame_id, pose
                return
        self._add_pose(stamp_ns, frame_id, pose)

    def _behind_s(self, stamp_ns: int) -> float:
        """How far a stamp is before the newest odometry [s]; negative where it is after that."""
        newest_ns = self._mapper.intake.newest_ns
        return 0.0 if newest_ns is None else (newest_ns - stamp_ns) * 1e-9

    def _add_pose(self, stamp_ns: int, frame_id: str, pose: SpatialPose) -> None:
        back_s, outliers = self._behind_s(stamp_ns), self._mapper.intake.outliers
        taken = self._mapper.add_pose(stamp_ns, pose, frame_id)
        if self._mapper.intake.outliers > outliers:
            self._refuse('an odometry message was stamped far ahead of the next one and is left out')
        self._settle()
        if not taken and frame_id != self._mapper.frame_id:
            self._refuse(f'it is in frame {frame_id!r}, the map is in {self._mapper.frame_id!r}; ~/reset forgets it')
        elif not taken:
            self._odometry.refuse(f'it is stamped {max(back_s, 0.0):.3f} s before the newest taken')

    def _refuse(self, reason: str) -> None:
        self._odometry.refuse(reason)
        self.get_logger().warning(f'odometry is refused: {reason}', throttle_duration_sec=10.0)

    def _take_echo(self, message: Any, received_ns: int) -> None:
        if self._solving.paused:
            self._mapper.drop('paused')
            return
        echo = self._live.current.echo
        try:
            ping = ping_from_message(message, echo.type, echo, self.get_clock().now().nanoseconds)
        except BadPing as error:
            self._mapper.drop(error.reason, str(error))
            return
        self._latency.arrived(ping.stamp_ns, received_ns)
        self._mapper.add_ping(ping)
        self._settle()

    def _go_on(self) -> None:
        """Use some of the pings that wait; of a backlog the next ones after a pause as long, for the messages."""
        self._catch_up.cancel()
        begun_ns = time.monotonic_ns()
        self._mapper.go_on()
        if self._mapper.intake.behind:
            self._catch_up.timer_period_ns = time.monotonic_ns() - begun_ns
            self._catch_up.reset()

    def _settle(self) -> None:
        if self._mapper.intake.behind and self._catch_up.is_canceled():
            self._catch_up.reset()

    def _do_chores(self) -> None:
        """What is done once a second; the heartbeat only every `HEARTBEAT_S`."""
        self._chores_done += 1
        self._later('automatic save', self._saver.autosave)
        self._later('beam map', self._outputs.publish_beam_map)
        self._later('diagnostics', self._diagnostics.publish)
        if self._chores_done % round(HEARTBEAT_S / CHORES_S) == 0:
            self._later('heartbeat', self._outputs.repeat)

    def _watch_clock(self) -> None:
        threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False)
        self._jump_handle = self.get_clock().create_jump_callback(threshold, post_callback=self._clock_jumped)

    def _clock_jumped(self, jump: Any) -> None:
        back_s = -jump.delta.nanoseconds * 1e-9
        if back_s > self._live.current.odometry.max_gap_s:
            self._jumped_back(f'/clock went back by {back_s:.3f} s')

    def _jumped_back(self, what: str) -> None:
        action = self._live.current.odometry.on_jump_back
        if action == 'reset':
            self.get_logger().warning(f'{what}: the map is reset (odometry.on_jump_back)')
            self.reset()
        else:
            self.get_logger().warning(f'{what}: what is older than the newest odometry is dropped '
                                      '(odometry.on_jump_back)', throttle_duration_sec=60.0)

    def _apply(self, parameters: Parameters) -> None:
        when_compiling(self.get_logger().info)  # another method may want other kernels
        self._mapper.configure(parameters)
        self._solving.drop()
        self._solving.set_period(parameters.solver.period_s)

    def _log_parameters(self, parameters: Parameters) -> None:
        values, defaults = parameters.flat(), Parameters().flat()
        differing = ', '.join(f'{name}: {value!r}' for name, value in values.items() if value != defaults[name])
        self.get_logger().info(f'parameters: {differing or "all"}{", the others" * bool(differing)} at their defaults')
        for name, value in values.items():
            self.get_logger().debug(f'parameter {name}: {value!r}')

    def _offer_services(self) -> None:
        self.create_service(Trigger, '~/reset', self._stopwatch.timed('reset', self._serve_reset))
        self.create_service(SetBool, '~/pause', self._serve_pause)

    def _serve_reset(self, request: Any, response: Any) -> Any:
        self.reset()
        self.get_logger().info('reset: the map is empty')
        response.success, response.message = True, 'the map is empty'
        return response

    def _serve_pause(self, request: Any, response: Any) -> Any:
        self._solving.paused = bool(request.data)
        self.get_logger().info('paused: pings are dropped, no solve begins' if request.data else 'running, not paused')
        response.success, response.message = True, 'paused' if request.data else 'running'
        return response
