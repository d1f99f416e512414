"""The place of one frame in another by static transforms, against scipy's rotations and the closed form of chains."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polymap_ros.messages.transforms import StaticTransforms
from polymap_ros.recordings.writing import make


def transform(parent, child, place, angles=(0.0, 0.0, 0.0)):
    x, y, z, w = Rotation.from_euler('ZYX', angles).as_quat()
    return make(
        'geometry_msgs/msg/TransformStamped', header=make('std_msgs/msg/Header', frame_id=parent), child_frame_id=child,
        transform=make('geometry_msgs/msg/Transform',
                       translation=make('geometry_msgs/msg/Vector3', x=place[0], y=place[1], z=place[2]),
                       rotation=make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)))


def tree(*transforms):
    found = StaticTransforms()
    for each in transforms:
        found.add(make('tf2_msgs/msg/TFMessage', transforms=[each]))
    return found


def matrix(place, angles):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = Rotation.from_euler('ZYX', angles).as_matrix(), place
    return found


ARM = ((0.3, -0.1, 0.5), (0.7, 0.2, -0.4))
TIP = ((0.0, 0.2, -0.1), (-1.1, 0.5, 0.9))
MAST = ((-0.2, 0.0, 1.0), (2.0, -0.3, 0.1))
ROBOT = tree(transform('base_link', 'arm', *ARM), transform('arm', 'sonar', *TIP),
             transform('base_link', 'mast', *MAST))


@pytest.mark.parametrize(('frame', 'base', 'expected'), [
    ('arm', 'base_link', matrix(*ARM)),
    ('sonar', 'base_link', matrix(*ARM) @ matrix(*TIP)),
    ('sonar', 'arm', matrix(*TIP)),
    ('base_link', 'sonar', np.linalg.inv(matrix(*ARM) @ matrix(*TIP))),
    ('sonar', 'mast', np.linalg.inv(matrix(*MAST)) @ matrix(*ARM) @ matrix(*TIP)),
    ('sonar', 'sonar', np.eye(4)), ('/sonar', '/arm', matrix(*TIP)),
])
def test_a_frame_is_found_up_and_down_the_tree(frame, base, expected):
    np.testing.assert_allclose(ROBOT.place(frame, base), expected[:3, 3], atol=1e-12)


def test_frames_that_are_not_connected_have_no_place():
    assert ROBOT.place('sonar', 'odom') is None
    assert ROBOT.place('camera', 'base_link') is None
    assert ROBOT.frames == ['arm', 'base_link', 'mast', 'sonar']


def test_the_last_word_counts_and_a_circle_ends():
    again = tree(transform('a', 'b', (1.0, 0.0, 0.0)), transform('a', 'b', (2.0, 0.0, 0.0)))
    assert again.place('b', 'a') == (2.0, 0.0, 0.0)
    circle = tree(transform('a', 'b', (1.0, 0.0, 0.0)), transform('b', 'a', (1.0, 0.0, 0.0)))
    assert circle.place('b', 'c') is None


def test_a_rotation_never_filled_in_is_left_out():
    empty = transform('a', 'b', (1.0, 0.0, 0.0))
    empty.transform.rotation.w = 0.0
    assert tree(empty).place('b', 'a') is None
