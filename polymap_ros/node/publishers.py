"""The node's outputs: polygon, markers, beamforming map and occupancy map, all latched."""

from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock
from rclpy.node import Node

from polymap_ros.errors import ParameterError
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages import markers, outputs
from polymap_ros.node.factory import make, message_class
from polymap_ros.node.qos import latched_output
from polymap_ros.parameters import Parameters
from polymap_ros.results.occupancy import occupancy_of

PERIOD_S = 0.005
"""Time between two messages, which are built one by one so that no callback takes long."""

BEAM_MAP_PERIOD_S = 1.0
HEARTBEAT_PERIOD_S = 10.0


class Latched:
    """A topic that remembers its last message, for the heartbeat."""

    def __init__(self, node: Node, name: str, type_name: str) -> None:
        self._publisher = node.create_publisher(message_class(type_name), f'~/{name}', latched_output())
        self._last: Any = None

    def publish(self, message: Any) -> None:
        """Publish on change."""
        self._last = message
        self._publisher.publish(message)

    def repeat(self) -> None:
        """Publish the last message again, for subscribers that are not transient local."""
        if self._last is not None:
            self._publisher.publish(self._last)


class Outputs:
    """Publishes what the mapper found; an open or ambiguous answer never as a polygon or a map.

    Parameters
    ----------
    node : Node
        Owner of publishers and timers.
    mapper : PolygonMapper
        What is shown.
    steady : Clock
        The steady clock.
    parameters : callable
        Gives the parameters in force.
    """

    def __init__(
        self, node: Node, mapper: PolygonMapper, steady: Clock, parameters: Callable[[], Parameters]
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
        self._timer = node.create_timer(PERIOD_S, self._publish_next, clock=steady)
        self._timer.cancel()
        node.create_timer(BEAM_MAP_PERIOD_S, self._publish_beam_map, clock=steady)
        node.create_timer(HEARTBEAT_PERIOD_S, self._repeat, clock=steady)

    def publish(self) -> None:
        """Publish the last estimate, message by message."""
        self._due = deque((self._publish_polygon, self._publish_markers, self._publish_map))
        self._timer.reset()

    def clear(self, frame_id: str) -> None:
        """Replace everything latched: no corners, no markers, one unknown cell, a map of zeros."""
        self._due.clear()
        self._polygon.publish(outputs.polygon_message(make, 0, frame_id, []))
        self._markers.publish(markers.delete_all_message(make, frame_id))
        self._map.publish(outputs.no_map_message(make, frame_id))
        self._beam_map.publish(outputs.beam_map_message(make, 0, self._start_frame, self._mapper.beam_map.values))
        self._mapped_pings = 0

    def _publish_next(self) -> None:
        if self._due:
            self._due.popleft()()
        if not self._due:
            self._timer.cancel()

    def _publish_polygon(self) -> None:
        estimate = self._mapper.estimate
        if estimate is not None and estimate.polygon is not None:
            self._polygon.publish(outputs.polygon_message(
                make, estimate.stamp_ns, self._mapper.frame_id, estimate.polygon.vertices))

    def _publish_markers(self) -> None:
        self._markers.publish(markers.marker_array_message(make, markers.drawing_of(self._mapper)))

    def _publish_map(self) -> None:
        estimate = self._mapper.estimate
        if estimate is None or estimate.polygon is None:
            return
        try:
            grid = occupancy_of(estimate.polygon.vertices, self._parameters())
        except ParameterError as error:
            self._node.get_logger().error(str(error), throttle_duration_sec=60.0)
            return
        self._map.publish(outputs.occupancy_grid_message(
            make, estimate.stamp_ns, self._mapper.frame_id, grid.cells, grid.resolution_m, grid.origin))

    def _publish_beam_map(self) -> None:
        """Publish the beamforming map where it has changed, at a limited rate, since it is large."""
        beam_map = self._mapper.beam_map
        if beam_map.count == self._mapped_pings:
            return
        self._mapped_pings = beam_map.count
        newest_ns = self._mapper.soundings[-1].stamp_ns if self._mapper.soundings else 0
        self._beam_map.publish(outputs.beam_map_message(make, newest_ns, self._start_frame, beam_map.values))

    def _repeat(self) -> None:
        for output in (self._polygon, self._markers, self._beam_map, self._map):
            self._due.append(output.repeat)
        self._timer.reset()
