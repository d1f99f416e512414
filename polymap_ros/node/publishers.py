"""The node's outputs: polygon, markers, beamforming map and occupancy map, all latched."""

from typing import Any

from rclpy.node import Node

from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages import markers, outputs
from polymap_ros.node.factory import make, message_class
from polymap_ros.node.qos import latched_output
from polymap_ros.parameters import Parameters
from polymap_ros.results.occupancy import occupancy_of


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
    """Publishes what the mapper found; an open or ambiguous answer never as a polygon or a map."""

    def __init__(self, node: Node, mapper: PolygonMapper) -> None:
        self._mapper = mapper
        self._start_frame = f'{node.get_name()}/start'
        self._polygon = Latched(node, 'polygon', 'geometry_msgs/msg/PolygonStamped')
        self._markers = Latched(node, 'markers', 'visualization_msgs/msg/MarkerArray')
        self._beam_map = Latched(node, 'beam_map', 'sensor_msgs/msg/Image')
        self._map = Latched(node, 'map', 'nav_msgs/msg/OccupancyGrid')
        self._mapped_pings = 0

    def publish(self, parameters: Parameters) -> None:
        """Publish the last estimate.

        Raises
        ------
        ParameterError
            Where `map.resolution_m` makes a map beyond reason; all but the map is published.
        """
        mapper, estimate = self._mapper, self._mapper.estimate
        self._markers.publish(markers.marker_array_message(make, markers.drawing_of(mapper)))
        if estimate is None or estimate.polygon is None:
            return
        vertices = estimate.polygon.vertices
        self._polygon.publish(outputs.polygon_message(make, estimate.stamp_ns, mapper.frame_id, vertices))
        grid = occupancy_of(vertices, parameters)
        self._map.publish(outputs.occupancy_grid_message(
            make, estimate.stamp_ns, mapper.frame_id, grid.cells, grid.resolution_m, grid.origin))

    def publish_beam_map(self) -> None:
        """Publish the beamforming map where it has changed; called at a limited rate, since it is large."""
        beam_map = self._mapper.beam_map
        if beam_map.count == self._mapped_pings:
            return
        self._mapped_pings = beam_map.count
        newest_ns = self._mapper.soundings[-1].stamp_ns if self._mapper.soundings else 0
        self._beam_map.publish(outputs.beam_map_message(make, newest_ns, self._start_frame, beam_map.values))

    def clear(self, frame_id: str) -> None:
        """Replace everything latched: no corners, no markers, one unknown cell, a map of zeros."""
        self._polygon.publish(outputs.polygon_message(make, 0, frame_id, []))
        self._markers.publish(markers.delete_all_message(make, frame_id))
        self._map.publish(outputs.no_map_message(make, frame_id))
        self._beam_map.publish(outputs.beam_map_message(make, 0, self._start_frame, self._mapper.beam_map.values))
        self._mapped_pings = 0

    def repeat(self) -> None:
        """The slow heartbeat."""
        for output in (self._polygon, self._markers, self._beam_map, self._map):
            output.repeat()
