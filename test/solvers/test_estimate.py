"""Moving and mirroring what a solver answers, deviations included."""

import numpy as np
import pytest

from polymap_ros.geometry.lines import mirrored_lines, polygon_lines
from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.geometry.pose import Pose
from polymap_ros.solvers.estimate import Candidate, Edge

LINES = np.array([(1.0, 0.1), (0.8, 1.7), (1.2, 3.0), (0.9, 4.6)])
MIDDLE, ALONG = np.array((0.3, -0.2)), np.array((np.cos(0.7), np.sin(0.7)))


def candidate(generator):
    """A polygon whose lines have a covariance that is known."""
    root = generator.normal(size=(8, 8)) * 1e-4
    covariance = root @ root.T
    edges = tuple(Edge(r, theta, 0.9, *np.sqrt(np.diag(covariance)[2 * k:2 * k + 2]), k, covariance[2 * k, 2 * k + 1])
                  for k, (r, theta) in enumerate(LINES.tolist()))
    return Candidate(half_plane_polygon(LINES)[0], edges, covariance)


def moved(lines):
    frame = Pose(0.4, -0.3, 0.9)
    theta = lines[:, 1] + frame.yaw
    return np.column_stack((lines[:, 0] + frame.x * np.cos(theta) + frame.y * np.sin(theta), theta))


@pytest.mark.parametrize(('change', 'of_lines', 'order'), [
    (lambda answer: answer.moved(Pose(0.4, -0.3, 0.9)), moved, [0, 1, 2, 3]),
    (lambda answer: answer.mirrored(MIDDLE, ALONG), lambda lines: mirrored_lines(lines, MIDDLE, ALONG), [2, 1, 0, 3]),
])
def test_covariances_follow_the_lines(change, of_lines, order):
    """Against the covariance of lines that were drawn at random and changed one by one."""
    generator = np.random.default_rng(3)
    answer = candidate(generator)
    changed = change(answer)
    draws = generator.multivariate_normal(LINES.ravel(), answer.covariance, 20000).reshape(-1, 4, 2)
    flat = np.array([of_lines(draw)[order].ravel() for draw in draws])
    flat[:, 1::2] = np.unwrap(flat[:, 1::2] - flat[:1, 1::2], axis=0)
    expected = np.cov(flat.T)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs(changed.covariance - expected).max() < 0.05 * scale.max()
    assert np.abs((changed.covariance - expected) / scale).max() < 0.05
    for k, edge in enumerate(changed.edges):
        own = changed.covariance[2 * k:2 * k + 2, 2 * k:2 * k + 2]
        assert (edge.r_std**2, edge.theta_std**2, edge.r_theta_covariance) == pytest.approx(
            (own[0, 0], own[1, 1], own[0, 1]))


def test_edges_stay_with_their_corners_in_the_mirror():
    image = candidate(np.random.default_rng(4)).mirrored(MIDDLE, ALONG)
    lines = np.array([(edge.r, edge.theta) for edge in image.edges])
    expected = polygon_lines(image.vertices)
    assert lines[:, 0] == pytest.approx(expected[:, 0])
    assert np.abs(np.angle(np.exp(1j * (lines[:, 1] - expected[:, 1])))).max() < 1e-12
    assert [edge.pings for edge in image.edges] == [2, 1, 0, 3]


def test_a_turned_edge_is_the_same_line_with_the_same_errors():
    edge = Edge(0.8, 1.7, 0.9, 1e-4, 2e-4, 3, 1.5e-8)
    turned, frame = edge.turned(), Pose(0.4, -0.3, 0.9)
    assert (turned.r, turned.theta, turned.r_theta_covariance) == pytest.approx((-0.8, 1.7 - np.pi, -1.5e-8))
    there, back = turned.moved(frame).turned(), edge.moved(frame)
    assert (there.r, there.theta, there.r_std, there.r_theta_covariance) == pytest.approx(
        (back.r, back.theta, back.r_std, back.r_theta_covariance))
