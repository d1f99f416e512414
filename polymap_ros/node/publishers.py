"""The node's outputs: polygon, markers, beamforming map and occupancy map, all latched."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeAlias

from rclpy.node import Node

from polymap_ros.errors import ParameterError
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.plane import XY
from polymap_ros.messages import markers, outputs
from polymap_ros.node.factory import make, message_class
from polymap_ros.node.later import Later
from polymap_ros.node.qos import latched_output, no_events
from polymap_ros.parameters import Parameters
from polymap_ros.results.occupancy import occupancy_of


class Latched:
    """A topic that remembers its last message, for the heartbeat, and whether that shows anything."""

    def __init__(self, node: Node, name: str, type_name: str) -> None:
        self._publisher = node.create_publisher(
            message_class(type_name), f'~/{name}', latched_output(), event_callbacks=no_events())
        self._last: Any = None
        self._shows = False

    def publish(self, message: Any) -> None:
        """Publish on change."""
        self._last, self._shows = message, True
        self._publisher.publish(message)

    def clear(self, message: Any) -> None:
        """Publish `message`, which says that there is nothing."""
        self.publish(message)
        self._shows = False

    def withdraw(self, message: Any) -> None:
        """Clear, unless nothing is shown already."""
        if self._shows:
            self.clear(message)

    def repeat(self) -> None:
        """Publish the last message again, for subscribers that are not transient local."""
        if self._last is not None:
            self._publisher.publish(self._last)


Ready: TypeAlias = Callable[[], None]
"""Publishes a message where it goes."""


class Outputs:
    """Publishes what the mapper found; an open or ambiguous answer never as a polygon or a map.

    Such an answer withdraws the polygon and the map of the one before.

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
        self._start_frame = f'{node.get_name()}/start'
        self._polygon = Latched(node, 'polygon', 'geometry_msgs/msg/PolygonStamped')
        self._markers = Latched(node, 'markers', 'visualization_msgs/msg/MarkerArray')
        self._beam_map = Latched(node, 'beam_map', 'sensor_msgs/msg/Image')
        self._map = Latched(node, 'map', 'nav_msgs/msg/OccupancyGrid')
        self._mapped_pings = 0
        self._due: deque[Callable[[], None]] = deque()
        self._publish_soon = partial(later, 'output', self._publish_next)

    def drawn(self, twin: PolygonMapper) -> list[Ready]:
        """The messages of a twin's estimate; in any thread."""
        marked = partial(self._markers.publish, markers.marker_array_message(make, markers.drawing_of(twin)))
        no_map = partial(self._map.withdraw, outputs.no_map_message(make, twin.frame_id))
        if twin.estimate is None or twin.estimate.polygon is None:
            no_polygon = outputs.polygon_message(make, 0, twin.frame_id, [])
            return [partial(self._polygon.withdraw, no_polygon), marked, no_map]
        vertices, stamp_ns, plane = twin.estimate.polygon.vertices, twin.estimate.stamp_ns, twin.plane or XY
        polygon = outputs.polygon_message(make, stamp_ns, twin.frame_id, vertices, plane)
        messages = [partial(self._polygon.publish, polygon), marked]
        try:
            grid = occupancy_of(vertices, self._parameters())
        except ParameterError as error:
            self._node.get_logger().error(str(error), throttle_duration_sec=60.0)
            return [*messages, no_map]
        return [*messages, partial(self._map.publish, outputs.occupancy_grid_message(
            make, stamp_ns, twin.frame_id, grid.cells, grid.resolution_m, grid.origin, plane))]

    def publish(self, messages: Sequence[Ready]) -> None:
        """Publish what was drawn, message by message."""
        self._due = deque(messages)
        self._publish_soon()

    def clear(self, frame_id: str) -> None:
        """Replace everything latched: no corners, no markers, one unknown cell, a map of zeros."""
        self._due.clear()
        self._polygon.clear(outputs.polygon_message(make, 0, frame_id, []))
        self._markers.publish(markers.delete_all_message(make, frame_id))
        self._map.clear(outputs.no_map_message(make, frame_id))
        self._beam_map.publish(outputs.beam_map_message(make, 0, self._start_frame, self._mapper.beam_map.values))
        self._mapped_pings = 0

    def _publish_next(self) -> None:
        if self._due:
            self._due.popleft()()
        if self._due:
            self._publish_soon()

    def publish_beam_map(self) -> None:
        """Publish the beamforming map where it has changed, at a limited rate, since it is large."""
        beam_map = self._mapper.beam_map
        if beam_map.count == self._mapped_pings:
            return
        self._mapped_pings = beam_map.count
        self._beam_map.publish(outputs.beam_map_message(
            make, self._mapper.places.last_ns, self._start_frame, beam_map.values))

    def repeat(self) -> None:
        """Publish all that is latched again."""
        for output in (self._polygon, self._markers, self._beam_map, self._map):
            self._due.append(output.repeat)
        self._publish_soon()
