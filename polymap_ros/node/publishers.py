"""The node's outputs: what `Latched` shows, published one by one by the executor's thread."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rclpy.node import Node

from polymap_ros.errors import in_words
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.latched import LATCHED, Latched, Ready
from polymap_ros.node.factory import make, message_class
from polymap_ros.node.later import Later
from polymap_ros.node.qos import latched_output, no_events
from polymap_ros.parameters import Parameters
from polymap_ros.results.occupancy import Occupancy, occupancy_of
from polymap_ros.results.save import map_cautions
from polymap_ros.solvers.estimate import Estimate


class Outputs:
    """Publishes what the mapper found.

    Parameters
    ----------
    node : Node
        Owner of the publishers.
    mapper : PolygonMapper
        What is shown.
    later : Later
        The executor's thread; messages are published one by one, so that no callback takes long.
    parameters : callable
        Gives the parameters in force.
    """

    def __init__(
        self, node: Node, mapper: PolygonMapper, later: Later, parameters: Callable[[], Parameters]
    ) -> None:
        self._node = node
        self._mapper = mapper
        self._parameters = parameters
        self._publishers = {
            name: node.create_publisher(
                message_class(kind), f'~/{name}', latched_output(), event_callbacks=no_events())
            for name, kind in LATCHED.items()
        }
        self._latched = Latched(make, self._send, node.get_name(), self._grid_of)
        self._due: deque[Ready] = deque()
        self._publish_soon = partial(later, 'output', self._publish_next)

    def drawn(self, twin: PolygonMapper) -> list[Ready]:
        """The messages of a twin's estimate; in any thread."""
        return self._latched.drawn(twin)

    def publish(self, messages: Sequence[Ready]) -> None:
        """Publish what was drawn, message by message."""
        self._due = deque(messages)
        self._publish_soon()

    def clear(self, frame_id: str) -> None:
        """Replace everything latched: no corners, no markers, one unknown cell, a map of zeros."""
        self._due.clear()
        self._latched.clear(frame_id, self._mapper.beam_map.values)

    def publish_beam_map(self) -> None:
        """Publish the beamforming map where it has changed, at a limited rate, since it is large."""
        self._latched.publish_beam_map(self._mapper)

    def repeat(self) -> None:
        """Publish all that is latched again."""
        self._due.extend(self._latched.repeated())
        self._publish_soon()

    def _publish_next(self) -> None:
        if self._due:
            self._due.popleft()()
        if self._due:
            self._publish_soon()

    def _send(self, name: str, message: Any) -> None:
        self._publishers[name].publish(message)

    def _grid_of(self, estimate: Estimate) -> Occupancy | None:
        """Draw the map; what fails there costs neither the polygon nor the answer."""
        log = self._node.get_logger()
        for caution in map_cautions(estimate, self._parameters()):
            log.warning(caution.text, throttle_duration_sec=60.0)
        try:
            return occupancy_of(estimate, self._parameters())
        except Exception as error:  # of numpy, or a fault of ours
            log.error(f'~/map cannot be drawn: {in_words(error)}', throttle_duration_sec=60.0)
            return None
