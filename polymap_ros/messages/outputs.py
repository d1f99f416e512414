"""From the mapper's results to messages.

Every function builds through a factory ``make(type_name, **fields)``, so that the same code gives rclpy's
messages and rosbags' dataclasses. All fields are named, since the dataclasses have no defaults; sequences of
numbers are numpy arrays of the field's type.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.cautions import Caution
from polymap_ros.geometry.plane import XY, Plane
from polymap_ros.geometry.pose import Pose
from polymap_ros.solvers.estimate import Candidate


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


def path_message(
    make: Make, stamp_ns: int, frame_id: str, stamps_ns: NDArray[np.int64], poses: NDArray[np.float64],
    plane: Plane = XY,
) -> Any:
    """nav_msgs/msg/Path of poses (n, 3) in the mapping plane, each with its stamp."""
    return make('nav_msgs/msg/Path', header=header(make, stamp_ns, frame_id), poses=[
        make('geometry_msgs/msg/PoseStamped', header=header(make, each_ns, frame_id),
             pose=pose_message(make, Pose(*pose), plane))
        for each_ns, pose in zip(stamps_ns.tolist(), poses.tolist(), strict=True)])


def pose_with_covariance_message(
    make: Make, stamp_ns: int, frame_id: str, pose: Any, covariance: NDArray[np.float64]
) -> Any:
    """geometry_msgs/msg/PoseWithCovarianceStamped of a pose message and the covariance (3, 3) of x, y and yaw."""
    whole = np.zeros((6, 6))
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
    return make('geometry_msgs/msg/PoseWithCovarianceStamped', header=header(make, stamp_ns, frame_id), pose=make(
        'geometry_msgs/msg/PoseWithCovariance', pose=pose, covariance=whole.ravel()))


def transform_message(make: Make, stamp_ns: int, frame_id: str, child_frame_id: str, pose: Pose) -> Any:
    """geometry_msgs/msg/TransformStamped: the child's pose in a frame, in the plane."""
    return make(
        'geometry_msgs/msg/TransformStamped', header=header(make, stamp_ns, frame_id), child_frame_id=child_frame_id,
        transform=make(
            'geometry_msgs/msg/Transform',
            translation=make('geometry_msgs/msg/Vector3', x=pose.x, y=pose.y, z=0.0),
            rotation=make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=float(np.sin(0.5 * pose.yaw)),
                          w=float(np.cos(0.5 * pose.yaw)))))


def coarse_polygon(polygon: Candidate, plane: Plane = XY) -> Caution | None:
    """Say that a Point32 cannot hold the corners to a tenth of the walls' deviations, where that is so."""
    corners = np.asarray(plane.points(polygon.vertices), dtype=float)
    lost_m = float(np.abs(corners - corners.astype(np.float32)).max())
    here = Pose(*(-polygon.vertices.mean(axis=0)).tolist())  # deviations of r as seen from afar say nothing
    deviations = [edge.moved(here).r_std or _UNKNOWN_M for edge in polygon.edges]
    if lost_m <= max(0.1 * min(deviations), _NEVER_TOLD_M):
        return None
    lost = f'{1e3 * lost_m:.2g}' if lost_m < 0.01 else f'{1e3 * lost_m:.0f}'
    return Caution('coarse_polygon', f'corners up to {np.abs(corners).max():.7g} m from the origin are rounded by up '
                                     f'to {lost} mm in ~/polygon, whose points have 32 bits')


_UNKNOWN_M = 1e-3
"""Where a method gives no deviation."""

_NEVER_TOLD_M = 1e-5
"""No robot drives by a hundredth of a millimetre."""


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
