"""Static transforms of tf2_msgs/msg/TFMessage: the place of one frame in another."""

from collections.abc import Iterator
from typing import Any

from polymap_ros.geometry.plane import SpatialPose, Vector


class StaticTransforms:
    """The tree of frames that never move against each other; of a frame given twice the last counts."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, SpatialPose]] = {}

    def add(self, message: Any) -> None:
        """Take the transforms of a TFMessage, of rclpy or of rosbags; those that are no rotation are left out."""
        for each in message.transforms:
            place, turn = each.transform.translation, each.transform.rotation
            pose = SpatialPose((float(place.x), float(place.y), float(place.z)),
                               (float(turn.x), float(turn.y), float(turn.z), float(turn.w)))
            if any(pose.orientation):
                self._parents[_plain(each.child_frame_id)] = _plain(each.header.frame_id), pose

    @property
    def frames(self) -> list[str]:
        """All names."""
        return sorted({*self._parents, *(parent for parent, _ in self._parents.values())})

    def place(self, frame: str, base: str) -> Vector | None:
        """The origin of `frame` in `base` [m]; None where the two are not connected."""
        below = dict(self._chain(base))
        for name, poses in self._chain(frame):
            if name in below:
                point = (0.0, 0.0, 0.0)
                for pose in poses:
                    point = pose.apply(point)
                for pose in reversed(below[name]):
                    point = pose.apply_inverse(point)
                return point
        return None

    def _chain(self, frame: str) -> Iterator[tuple[str, list[SpatialPose]]]:
        """A frame and those above it, each with the poses that lead there."""
        name, poses, seen = _plain(frame), list[SpatialPose](), set[str]()
        while name not in seen:
            yield name, list(poses)
            seen.add(name)
            if name in self._parents:
                name, pose = self._parents[name]
                poses.append(pose)


def _plain(name: str) -> str:
    """Names of ROS 1 begin with a slash, as in converted recordings."""
    return name.lstrip('/')
