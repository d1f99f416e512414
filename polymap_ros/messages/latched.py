"""What a mapping node shows: polygon, markers, beamforming map and occupancy map, all latched."""

from collections.abc import Callable
from functools import partial
from types import MappingProxyType
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.plane import XY
from polymap_ros.geometry.poses import in_frame
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.markers import delete_all_message, drawing_of, marker_array_message
from polymap_ros.messages.outputs import (
    Make,
    beam_map_message,
    no_map_message,
    occupancy_grid_message,
    path_message,
    polygon_message,
)
from polymap_ros.messages.shown import shown
from polymap_ros.solvers.estimate import Estimate

LATCHED = MappingProxyType({
    'polygon': 'geometry_msgs/msg/PolygonStamped',
    'markers': 'visualization_msgs/msg/MarkerArray',
    'beam_map': 'sensor_msgs/msg/Image',
    'map': 'nav_msgs/msg/OccupancyGrid',
    'path': 'nav_msgs/msg/Path',
})
"""Types of the latched topics by their names below the node's."""

MAX_POSES = 2000
"""Poses of a path, at most."""

Ready: TypeAlias = Callable[[], None]
"""Publishes a message where it goes."""


class Grid(Protocol):
    """An occupancy map; see `polymap_ros.results.occupancy`."""

    @property
    def cells(self) -> NDArray[Any]: ...

    @property
    def resolution_m(self) -> float: ...

    @property
    def origin(self) -> tuple[float, float]: ...


class _Topic:
    """A topic that remembers its last message, for the heartbeat, and whether that shows anything."""

    def __init__(self, send: Callable[[Any], None]) -> None:
        self._send = send
        self._last: Any = None
        self._shows = False

    def publish(self, message: Any) -> None:
        """Publish on change."""
        self._last, self._shows = message, True
        self._send(message)

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
            self._send(self._last)


class Latched:
    """Publishes what a mapper found; an open or ambiguous answer never as a polygon or a map.

    Such an answer withdraws the polygon and the map of the one before.

    Parameters
    ----------
    make : Make
        Builds the messages.
    send : callable
        Publishes a message on the topic of a name in `LATCHED`.
    node_name : str
        The node's name, from which that of the start frame is made.
    grid_of : callable
        Draws the occupancy map of a closed answer; None where that cannot be.
    """

    def __init__(
        self, make: Make, send: Callable[[str, Any], None], node_name: str,
        grid_of: Callable[[Estimate], Grid | None],
    ) -> None:
        self._make, self._grid_of = make, grid_of
        self._start_frame = f'{node_name}/start'
        self._topics = {name: _Topic(partial(send, name)) for name in LATCHED}
        self._polygon, self._markers, self._beam_map, self._map, self._path = self._topics.values()
        self._mapped_pings = 0

    def drawn(self, mapper: PolygonMapper) -> list[Ready]:
        """Return what publishes a mapper's estimate, message by message; built here, in any thread."""
        make, (frame_id, motion) = self._make, shown(mapper)
        estimate = mapper.estimate and mapper.estimate.moved(motion)
        marked = partial(self._markers.publish, marker_array_message(make, drawing_of(mapper)))
        path = partial(self._path.publish, self._path_message(mapper))
        no_map = partial(self._map.withdraw, no_map_message(make, frame_id))
        if estimate is None or estimate.polygon is None:
            return [partial(self._polygon.withdraw, polygon_message(make, 0, frame_id, [])), marked, path, no_map]
        corners, stamp_ns, plane = estimate.polygon.vertices, estimate.stamp_ns, mapper.plane or XY
        polygon = partial(self._polygon.publish, polygon_message(make, stamp_ns, frame_id, corners, plane))
        if (grid := self._grid_of(estimate)) is None:
            return [polygon, marked, path, no_map]
        return [polygon, marked, path, partial(self._map.publish, occupancy_grid_message(
            make, stamp_ns, frame_id, grid.cells, grid.resolution_m, grid.origin, plane))]

    def _path_message(self, mapper: PolygonMapper) -> Any:
        """The base at the pings that are not lost; of many evenly spread ones, the newest included."""
        (frame_id, motion), path = shown(mapper), mapper.path()
        placed = np.flatnonzero(~path.lost)
        every = max(-(-len(placed) // MAX_POSES), 1)
        some = placed[::-1][::every][::-1]
        stamp_ns = int(path.stamps_ns[some[-1]]) if len(some) else 0
        return path_message(self._make, stamp_ns, frame_id, path.stamps_ns[some], in_frame(path.poses[some], motion),
                            mapper.plane or XY)

    def clear(self, frame_id: str, beam_map: NDArray[Any]) -> None:
        """Replace everything: no corners, no markers, one unknown cell, the beamforming map as it is now, of zeros."""
        self._polygon.clear(polygon_message(self._make, 0, frame_id, []))
        self._markers.publish(delete_all_message(self._make, frame_id))
        self._map.clear(no_map_message(self._make, frame_id))
        self._path.clear(path_message(self._make, 0, frame_id, np.empty(0, np.int64), np.empty((0, 3))))
        self._beam_map.publish(beam_map_message(self._make, 0, self._start_frame, beam_map))
        self._mapped_pings = 0

    def publish_beam_map(self, mapper: PolygonMapper) -> None:
        """Publish the beamforming map where it has changed; to be called at a limited rate, since it is large."""
        beam_map = mapper.surroundings.beam_map
        if beam_map.count != self._mapped_pings:
            self._mapped_pings = beam_map.count
            self._beam_map.publish(beam_map_message(
                self._make, mapper.places.last_ns, self._start_frame, beam_map.values))

    def repeated(self) -> list[Ready]:
        """Return what publishes all last messages again."""
        return [topic.repeat for topic in self._topics.values()]
