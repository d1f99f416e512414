"""A robot in a map that is given: found from nowhere, followed, carried away, told; against the simulated truth."""

import dataclasses

import numpy as np
import pytest
from shapely import Polygon

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import UsageError
from polymap_ros.evaluation.slam_experiment import CASES
from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.poses import in_frame
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

MAP = Pose(1.0, 2.0, 0.5)
"""Where the truth is in the frame of the map: not where the odometry begins."""


class Drive:
    """Pings of a scene with drifting odometry, in the map of some outline."""

    def __init__(self, scene, outline=None, **values):
        self.scene, self.samples, self.reported = scene, simulate(scene), scene.reported_poses()
        parameters = Parameters().replaced({'slam.mode': 'localization', **values})
        outline = MAP.apply(scene.vertices if outline is None else outline)
        self.mapper = PolygonMapper(scene.parameters(parameters), scene.recorded_pulse, outline=outline)

    def go(self, first, end):
        for stamp, pose, samples in list(zip(
                self.scene.stamps_ns.tolist(), self.reported.tolist(), self.samples, strict=True))[first:end]:
            self.mapper.add_pose(stamp, Pose(*pose))
            self.mapper.add_ping(Ping(stamp, samples, self.scene.period_s, self.scene.t0_s))
        return self.mapper.solve()

    def off(self, ping):
        """How far the newest pose is from the truth of a ping [m], [rad]."""
        x, y, yaw = in_frame(self.scene.poses[ping:ping + 1], MAP)[0]
        _, here = self.mapper.newest()
        return np.hypot(here.x - x, here.y - y), abs(wrapped(here.yaw - yaw))


def texts(estimate):
    return [caution.text for caution in estimate.cautions]


@pytest.fixture
def drive():
    return Drive(dataclasses.replace(CASES['typical'].make(2, 5), snr_db=0.0))


def test_from_nowhere_it_is_found_and_followed_to_the_tenth_of_a_millimetre(drive):
    assert drive.mapper.newest() is None
    estimate = drive.go(0, 4)
    assert estimate.status == 'open'
    assert drive.mapper.newest() is None
    assert 'drive on' in estimate.cautions[0].remedy
    for first, end in ((4, 14), (14, 30), (30, 60)):
        estimate = drive.go(first, end)
        assert estimate.status == 'closed'
        away_m, turned_rad = drive.off(end - 1)
        assert away_m < 1e-3
        assert turned_rad < 0.1
    given = Polygon(MAP.apply(drive.scene.vertices))
    assert Polygon(estimate.polygon.vertices).symmetric_difference(given).area < 1e-9
    path = drive.mapper.path()
    true = MAP.apply(drive.scene.poses[:, :2])
    assert np.max(np.hypot(*(path.poses[:, :2] - true).T)) < 1e-3
    z = (estimate.trajectory.poses - in_frame(drive.scene.poses[-len(estimate.trajectory.poses):], MAP))[:, :2]
    z = z / np.sqrt(np.diagonal(estimate.trajectory.covariances, axis1=1, axis2=2)[:, :2])
    assert np.mean(np.abs(z) < 3.0) > 0.9


def test_carried_away_it_is_found_elsewhere(drive):
    drive.go(0, 16)
    away_m = np.hypot(*(drive.scene.poses[16:46, :2] - drive.scene.poses[15, :2]).T)
    there = 16 + int(np.argmax(away_m))
    assert away_m.max() > 0.5
    carried = Pose(*drive.reported[15].tolist()).compose(Pose(*drive.reported[there].tolist()).inverse())
    drive.reported[there:] = in_frame(drive.reported[there:], carried)
    lost = drive.go(there, there + 3)
    assert any('fit no place' in text for text in texts(lost))
    found = drive.go(there + 3, there + 14)
    assert found.status == 'closed'
    assert drive.off(there + 13)[0] < 1e-3


def test_in_another_place_it_is_nowhere(drive):
    other = Drive(drive.scene, CASES['typical'].make(4, 5).vertices)
    estimate = other.go(0, 20)
    assert (estimate.status, estimate.polygon, estimate.trajectory) == ('open', None, None)
    assert 'output.load_path' in estimate.cautions[0].remedy
    assert other.mapper.newest() is None


@pytest.fixture
def rectangle():
    scene = load_scene('rectangle', None)
    return Drive(dataclasses.replace(scene, faults=dataclasses.replace(scene.faults, drift='typical')))


def test_in_a_rectangle_both_places_are_told(rectangle):
    estimate = rectangle.go(0, 14)
    assert estimate.status == 'open'
    x, y, _ = in_frame(rectangle.scene.poses[13:14], MAP)[0]
    middle = MAP.apply(rectangle.scene.vertices).mean(axis=0)
    for place in ((x, y), 2.0 * middle - (x, y)):
        assert f'({place[0]:.3f}, {place[1]:.3f}) m' in estimate.cautions[0].text
    assert 'initialpose' in estimate.cautions[0].remedy


@pytest.mark.parametrize('other', [False, True])
def test_who_is_told_which_of_both_goes_on_there(rectangle, other):
    rectangle.go(0, 14)
    base = MAP.compose(Pose(*rectangle.scene.poses[13].tolist()))
    if other:
        middle = MAP.apply(rectangle.scene.vertices).mean(axis=0)
        base = Pose(2.0 * middle[0] - base.x, 2.0 * middle[1] - base.y, base.yaw + np.pi)
    rectangle.mapper.expect(Pose(base.x + 0.05, base.y - 0.03, base.yaw + 0.1), 0.1, 0.2)
    assert rectangle.go(14, 24).status == 'closed'
    if not other:
        assert rectangle.off(23)[0] < 1e-3
    assert (rectangle.off(23)[0] > 0.05) == other


def test_a_pose_that_is_none_is_refused(drive):
    with pytest.raises(UsageError, match='no ping has come yet'):
        drive.mapper.expect(Pose(*MAP.apply(drive.scene.vertices).mean(axis=0)), 0.1, 0.1)
    drive.go(0, 3)
    with pytest.raises(UsageError, match='outside of the map'):
        drive.mapper.expect(Pose(50.0, 0.0), 0.1, 0.1)
    with pytest.raises(UsageError, match='localization only'):
        PolygonMapper(Parameters()).expect(Pose(0.0, 0.0), 0.1, 0.1)


def test_a_reset_forgets_the_pose_and_not_the_map(drive):
    drive.go(0, 14)
    drive.mapper.reset()
    assert drive.mapper.newest() is None
    assert drive.go(20, 34).status == 'closed'
    assert drive.off(33)[0] < 1e-3


@pytest.mark.parametrize(('outline', 'told'), [
    (None, 'found none'),
    ([(0.0, 0.0), (1.0, 0.0)], r'shape \(2, 2\)'),
    ([(0.0, 0.0), (1.0, 0.0), (1.0, np.nan)], 'shape'),
    ([(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)], 'cross'),
    ([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 0.5), (0.0, 2.0)], 'not convex'),
    ('a plate', 'not numbers'),
])
def test_an_outline_that_is_none_is_refused(outline, told):
    with pytest.raises(UsageError, match=told):
        PolygonMapper(Parameters().replaced({'slam.mode': 'localization'}), outline=outline)
