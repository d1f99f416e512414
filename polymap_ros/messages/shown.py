"""In which frame answers are shown: the map's, or where none is named the odometry's as of the newest ping."""

from typing import NamedTuple

from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper


class Shown(NamedTuple):
    """The name of a frame, and the pose in it of the map frame, in which estimates are."""

    frame_id: str
    of_map: Pose


def shown(mapper: PolygonMapper) -> Shown:
    """Return the frame of a mapper's topics.

    Without a map frame to follow, what surrounds the robot now is where the robot sees it: the answer is moved by what
    the odometry has drifted.
    """
    estimate = mapper.estimate
    if mapper.parameters.slam.map_frame or estimate is None or estimate.trajectory is None:
        return Shown(mapper.map_frame, Pose(0.0, 0.0))
    return Shown(mapper.frame_id, estimate.trajectory.map_to_odom.inverse())
