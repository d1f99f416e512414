"""The sensor's place in the robot's base frame from a recording's static transforms."""

from collections.abc import Callable

from polymap_ros.errors import BadPing, RecordingError
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.transforms import StaticTransforms
from polymap_ros.recordings.reading import Recording

TF_TYPE = 'tf2_msgs/msg/TFMessage'
STATIC = 'tf_static'


def sensor_places(recording: Recording, odom_topic: str) -> Callable[[str], Pose]:
    """Read all topics called ``tf_static``, in any namespace, and the base frame of the first odometry message.

    Parameters
    ----------
    recording : Recording
        Open.
    odom_topic : str
        As recorded.

    Returns
    -------
    callable
        Gives the place of a frame in the base frame; raises `BadPing`, ``no_pose``, where they are not connected.

    Raises
    ------
    RecordingError
        Where there are no static transforms.
    """
    topics = [topic for topic, info in recording.topics.items()
              if topic.rpartition('/')[2] == STATIC and info.type_name == TF_TYPE and info.message_count]
    if not topics:
        raise RecordingError(f'{recording.path}: holds no {TF_TYPE} on /{STATIC}, which sensor.from_tf needs; give '
                             'sensor.x_m and sensor.y_m instead')
    tree = StaticTransforms()
    for entry in recording.messages(topics):
        tree.add(entry.message)
    first = next(recording.messages([odom_topic]), None)
    base = '' if first is None else first.message.child_frame_id

    def place(frame_id: str) -> Pose:
        found = tree.place(frame_id, base)
        if found is None:
            raise BadPing('no_pose', f'{topics[0]} does not connect the echo\'s frame {frame_id!r} to the odometry\'s '
                                     f'child frame {base!r} (sensor.from_tf); it holds {", ".join(tree.frames)}')
        return Pose(*found[:2])

    return place
