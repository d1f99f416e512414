"""One input topic of the node: its messages, its publishers, and why it may be silent."""

import time
from collections.abc import Callable
from typing import Any

from rclpy._rclpy_pybind11 import RCLError
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible, qos_policy_name_from_kind

from polymap_ros.errors import ParameterError, UsageError
from polymap_ros.messages.diagnostics import SILENCE_S
from polymap_ros.node.factory import message_class
from polymap_ros.node.qos import overridable, sensor_input
from polymap_ros.node.stopwatch import Stopwatch

_SHOWN = 3
"""Topics or nodes of which so many are told."""


class Input:
    """A subscription that counts and can say why nothing comes.

    Parameters
    ----------
    node : Node
        The subscriber.
    topic : str
        Name before remapping.
    type_name : str
        Such as ``nav_msgs/msg/Odometry``.
    take : callable
        Called with each message and the time [ns, system clock] at which it was received.
    stopwatch : Stopwatch
        Times `take`.

    Raises
    ------
    UsageError
        For a topic that has another type in this node.
    ParameterError
        For a QoS override that is not allowed.

    Attributes
    ----------
    received, refused, lost, incompatible : int
        Messages that came, those of them that were no use, messages the middleware lost, publishers that offer
        a QoS we cannot take.
    refusal : str
        Why the last message that was no use was refused.
    """

    def __init__(self, node: Node, topic: str, type_name: str, take: Callable[[Any, int], None],
                 stopwatch: Stopwatch) -> None:
        self.type_name = type_name
        self.received = self.refused = self.lost = self.incompatible = 0
        self.refusal = ''
        self._node, self._name = node, topic
        self._take = take
        self._newest_s = time.monotonic()
        events = SubscriptionEventCallbacks(incompatible_qos=self._incompatible, message_lost=self._lost)
        try:
            self._subscription = node.create_subscription(
                message_class(type_name), topic, stopwatch.timed(topic, self._received), sensor_input(),
                event_callbacks=events, qos_overriding_options=overridable())
        except RCLError as error:  # of the topic, and rcl's words lead nowhere: invalid allocator
            raise UsageError(f'{node.resolve_topic_name(topic)} cannot be subscribed to as {type_name}: is it remapped '
                             'to another topic of this node?') from error
        except (RuntimeError, ValueError, TypeError, ParameterException) as error:
            name = f'qos_overrides.{node.resolve_topic_name(topic)}.subscription.*'
            raise ParameterError(name, str(error)) from error

    @property
    def topic(self) -> str:
        """The topic's full name after remapping."""
        return str(self._subscription.topic_name)

    @property
    def silent(self) -> bool:
        """Nothing came for `SILENCE_S`."""
        return time.monotonic() - self._newest_s > SILENCE_S

    def reason(self) -> str:
        """Say in words why nothing comes."""
        publishers = self._node.get_publishers_info_by_topic(self.topic)
        if not publishers:
            others = [name for name, types in self._node.get_topic_names_and_types()
                      if self.type_name in types and self._node.count_publishers(name)]
            found = f'; {self.type_name} is published on {", ".join(others[:_SHOWN])}' if others else ''
            return f'no publisher on {self.topic}{found}{f": remap it ({self._remap(others[0])})" if others else ""}'
        alike = [each for each in publishers if each.topic_type == self.type_name]
        if not alike:
            found = ', '.join(sorted({each.topic_type for each in publishers}))
            return f'wrong type on {self.topic}: published is {found}, expected {self.type_name}'
        for each in alike:
            compatible, why = qos_check_compatible(each.qos_profile, self._subscription.qos_profile)
            if compatible == QoSCompatibility.ERROR:
                text = why.replace('ERROR:', '').strip().rstrip(';').lower()
                return f'incompatible QoS on {self.topic}: {text}; {self._remedy}'
        return f'{self.topic} has a publisher, but no message {"came" if self.received == 0 else "comes any more"}'

    def crowd(self) -> str:
        """Say in words that several publish on the topic, whose messages are mixed; empty where none or one does."""
        publishers = self._node.get_publishers_info_by_topic(self.topic)
        if len(publishers) < 2:
            return ''
        names = sorted({f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in publishers})
        return (f'{len(publishers)} publishers on {self.topic} ({", ".join(names[:_SHOWN])}), whose messages are '
                'mixed: stop all but one')

    def _remap(self, found: str) -> str:
        return f'--ros-args -r {self._name}:={found}'

    @property
    def _remedy(self) -> str:
        return f'ours can be set by qos_overrides.{self.topic}.subscription.*'

    def refuse(self, reason: str) -> None:
        """Count a message that came and was no use."""
        self.refused += 1
        self.refusal = reason

    def _received(self, message: Any, info: dict[str, Any]) -> None:
        self.received += 1
        self._newest_s = time.monotonic()
        self._take(message, info['received_timestamp'] or time.time_ns())

    def _lost(self, event: Any) -> None:
        self.lost = event.total_count

    def _incompatible(self, event: Any) -> None:
        self.incompatible = event.total_count
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        self._node.get_logger().warning(f'a publisher on {self.topic} offers incompatible QoS ({policy}); '
                                        f'{self._remedy}')
