"""Plays messages onto topics at their own pace, with ``/clock``."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from polymap_ros.messages.outputs import time_message
from polymap_ros.node.factory import converted, make, message_class
from polymap_ros.node.joining import init, refusals_told
from polymap_ros.node.qos import played

PLAYER_NAME = 'polymap_play'

CLOCK_PERIOD_S = 0.01
"""Time between messages on ``/clock``."""

POLL_S = 0.05


class Player(Node):  # type: ignore[misc]
    """Publishes any iterator of messages, reliable.

    Parameters
    ----------
    topics : dict[str, str]
        Type by topic.
    rate : float
        Speed; 2 plays twice as fast.
    """

    def __init__(self, topics: dict[str, str], rate: float = 1.0) -> None:
        super().__init__(PLAYER_NAME, start_parameter_services=False)
        self._rate = rate
        self._publishers_by_topic = {
            topic: self.create_publisher(message_class(type_name), topic, played())
            for topic, type_name in topics.items()
        }
        self._clock_publisher = self.create_publisher(Clock, '/clock', played())

    def wait(self, timeout_s: float, show: Callable[[list[str], float], object] = lambda *_: None) -> list[str]:
        """Wait until every topic has a subscriber; return those that still have none after `timeout_s`.

        `show` is called with the topics waited for and the time that has passed [s].
        """
        begun_s = time.monotonic()
        while (lonely := self._lonely()) and (waited_s := time.monotonic() - begun_s) < timeout_s:
            show(lonely, waited_s)
            time.sleep(POLL_S)
        return lonely

    def misfits(self, topics: list[str]) -> list[str]:
        """Those of the topics, without a subscriber, that have one of another type or with a QoS that does not fit."""
        return [topic for topic in topics if self.count_subscribers(topic)]

    def play(self, messages: Iterable[tuple[str, str, Any, int]]) -> int:
        """Publish (topic, type_name, message, ns) at its time; return how many were published.

        Messages may be of rclpy or dataclasses with the same fields, in the order of their time.
        """
        count, first_ns, clock_ns, started_s = 0, 0, 0, time.monotonic()
        step_ns = round(CLOCK_PERIOD_S * 1e9 * self._rate)
        for topic, type_name, message, ns in messages:
            if count == 0:
                first_ns, clock_ns = ns, ns - step_ns
            while clock_ns + step_ns <= ns:
                clock_ns += step_ns
                self._sleep_until(started_s + (clock_ns - first_ns) * 1e-9 / self._rate)
                self._clock_publisher.publish(Clock(clock=time_message(make, clock_ns)))
            self._sleep_until(started_s + (ns - first_ns) * 1e-9 / self._rate)
            self._publishers_by_topic[topic].publish(converted(message, type_name))
            count += 1
        return count

    def flush(self, timeout_s: float) -> None:
        """Wait until every reliable subscriber has everything, at most `timeout_s`."""
        for publisher in self._publishers_by_topic.values():
            publisher.wait_for_all_acked(Duration(seconds=timeout_s))

    def _lonely(self) -> list[str]:
        return [publisher.topic_name for publisher in self._publishers_by_topic.values()
                if publisher.get_subscription_count() == 0]

    @staticmethod
    def _sleep_until(when_s: float) -> None:
        remaining_s = when_s - time.monotonic()
        if remaining_s > 0.0:
            time.sleep(remaining_s)


@contextmanager
def playing(topics: dict[str, str], rate: float, arguments: Sequence[str]) -> Iterator[Player]:
    """A player while the ``with`` block lasts; Ctrl-C is left to Python, and interrupts it at once."""
    init(PLAYER_NAME, arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        with refusals_told():
            player = Player(topics, rate)
        try:
            yield player
        finally:
            player.destroy_node()
    finally:
        rclpy.try_shutdown()
