"""From the mapper's results to messages.

Every function builds through a factory ``make(type_name, **fields)``, so that the same code gives rclpy's
messages and rosbags' dataclasses. All fields are named, since the dataclasses have no defaults; sequences of
numbers are numpy arrays of the field's type.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.mapping.plane import XY, Plane
from polymap_ros.mapping.pose import Pose


class Make(Protocol):
    """Builds a message of the named type from all its fields."""

    def __call__(self, type_name: str, /, **fields: Any) -> Any: ...


def time_message(make: Make, ns: int) -> Any:
    """builtin_interfaces/msg/Time of integer nanoseconds."""
    sec, nanosec = divmod(ns, 1_000_000_000)
    return make('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)


def header(make: Make, stamp_ns: int, frame_id: str) -> Any:
    """std_msgs/msg/Header."""
    return make('std_msgs/msg/Header', stamp=time_message(make, stamp_ns), frame_id=frame_id)


def pose_message(make: Make, pose: Pose, plane: Plane = XY) -> Any:
    """geometry_msgs/msg/Pose, in the odometry's frame, of a pose in the mapping plane."""
    spatial = plane.spatial(pose)
    return make(
        'geometry_msgs/msg/Pose',
        position=make('geometry_msgs/msg/Point', **dict(zip('xyz', spatial.position, strict=True))),
        orientation=make('geometry_msgs/msg/Quaternion', **dict(zip('xyzw', spatial.orientation, strict=True))),
    )


def point_messages(
    make: Make, coordinates: ArrayLike, plane: Plane = XY, type_name: str = 'geometry_msgs/msg/Point'
) -> list[Any]:
    """Points, in the odometry's frame, of coordinates (n, 2) in the mapping plane [m]."""
    return [make(type_name, x=x, y=y, z=z) for x, y, z in plane.points(np.asarray(coordinates)).tolist()]


def odometry_message(make: Make, stamp_ns: int, frame_id: str, pose: Pose, child_frame_id: str = 'base_link') -> Any:
    """nav_msgs/msg/Odometry with pose only: velocities and covariances are zero."""
    zero = {'x': 0.0, 'y': 0.0, 'z': 0.0}
    twist = make('geometry_msgs/msg/Twist', linear=make('geometry_msgs/msg/Vector3', **zero),
                 angular=make('geometry_msgs/msg/Vector3', **zero))
    return make(
        'nav_msgs/msg/Odometry', header=header(make, stamp_ns, frame_id), child_frame_id=child_frame_id,
        pose=make('geometry_msgs/msg/PoseWithCovariance', pose=pose_message(make, pose), covariance=np.zeros(36)),
        twist=make('geometry_msgs/msg/TwistWithCovariance', twist=twist, covariance=np.zeros(36)),
    )


def echo_message(make: Make, ping: Ping, scan_time_s: float = 0.0) -> Any:
    """sensor_msgs/msg/LaserScan used as an A-scan: the samples are its intensities, ranges is empty."""
    return make(
        'sensor_msgs/msg/LaserScan', header=header(make, ping.stamp_ns, ping.frame_id),
        angle_min=0.0, angle_max=0.0, angle_increment=0.0, time_increment=ping.period_s, scan_time=scan_time_s,
        range_min=ping.range_min_m, range_max=ping.range_max_m, ranges=np.empty(0, np.float32),
        intensities=np.asarray(ping.samples, np.float32),
    )


def polygon_message(make: Make, stamp_ns: int, frame_id: str, vertices: ArrayLike, plane: Plane = XY) -> Any:
    """geometry_msgs/msg/PolygonStamped of the corners (n, 2) [m], counter-clockwise, the first not repeated.

    z is 0, and in another plane than the odometry's xy plane what that plane has there.
    """
    points = point_messages(make, vertices, plane, 'geometry_msgs/msg/Point32')
    return make('geometry_msgs/msg/PolygonStamped', header=header(make, stamp_ns, frame_id),
                polygon=make('geometry_msgs/msg/Polygon', points=points))


def beam_map_message(make: Make, stamp_ns: int, frame_id: str, values: NDArray[np.floating]) -> Any:
    """sensor_msgs/msg/Image 32FC1 of the beamforming map, rows theta, columns r."""
    cells = np.ascontiguousarray(values, dtype='<f4')
    rows, columns = cells.shape
    return make('sensor_msgs/msg/Image', header=header(make, stamp_ns, frame_id), height=rows, width=columns,
                encoding='32FC1', is_bigendian=0, step=4 * columns, data=cells.reshape(-1).view(np.uint8))


def occupancy_grid_message(
    make: Make, stamp_ns: int, frame_id: str, cells: ArrayLike, resolution_m: float, origin: tuple[float, float],
    plane: Plane = XY,
) -> Any:
    """nav_msgs/msg/OccupancyGrid.

    Parameters
    ----------
    cells : array_like, shape (rows, columns)
        0 free, 100 occupied, -1 unknown; row 0 at the smallest y.
    resolution_m : float
        Cell size [m].
    origin : (float, float)
        Corner of cell (0, 0) nearest the origin of the axes [m].
    plane : Plane
        In which the map lies; the pose of its origin says where that is.
    """
    grid = np.ascontiguousarray(cells, dtype=np.int8)
    rows, columns = grid.shape
    info = make('nav_msgs/msg/MapMetaData', map_load_time=time_message(make, stamp_ns), resolution=resolution_m,
                width=columns, height=rows, origin=pose_message(make, Pose(*origin), plane))
    return make('nav_msgs/msg/OccupancyGrid', header=header(make, stamp_ns, frame_id), info=info,
                data=grid.reshape(-1))


def no_map_message(make: Make, frame_id: str) -> Any:
    """The map after a reset: one unknown cell, since Nav2 rejects an empty map."""
    return occupancy_grid_message(make, 0, frame_id, [[-1]], 1.0, (0.0, 0.0))
