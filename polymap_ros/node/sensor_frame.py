"""The sensor's place in the robot's base frame from TF, where tf2_ros is installed."""

from rclpy.node import Node
from rclpy.time import Time

from polymap_ros.errors import BadPing, ParameterError
from polymap_ros.geometry.pose import Pose


class SensorFrame:
    """Asks TF for the place of a frame until it is known, and keeps it.

    Parameters
    ----------
    node : Node
        Listens to ``/tf`` and ``/tf_static``.

    Raises
    ------
    ParameterError
        Where tf2_ros is not installed.

    Attributes
    ----------
    base : str
        The odometry's child_frame_id; empty as long as there is none.
    """

    def __init__(self, node: Node) -> None:
        try:
            import tf2_ros
        except ImportError as error:
            raise ParameterError('sensor.from_tf', f'true needs tf2_ros, which is not installed ({error}): install '
                                 'ros-jazzy-tf2-ros-py, or give sensor.x_m and sensor.y_m') from error
        self.base = ''
        self._error = tf2_ros.TransformException
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._places: dict[str, Pose] = {}

    def __call__(self, frame_id: str) -> Pose | None:
        """Place of a frame in the base frame; None as long as TF does not connect the two.

        Raises
        ------
        BadPing
            ``no_pose`` for a frame without a name.
        """
        if not frame_id:
            raise BadPing('no_pose', 'the echo has no frame_id, by which sensor.from_tf looks for its place')
        if frame_id not in self._places and self.base:
            try:
                found = self._buffer.lookup_transform(self.base, frame_id, Time()).transform.translation
            except self._error:
                return None
            self._places[frame_id] = Pose(float(found.x), float(found.y))
        return self._places.get(frame_id)
