"""The picture can be drawn of every answer, and shows what belongs in it."""

import dataclasses
import io
import os
import subprocess
import sys

import numpy as np
import pytest

from polymap_ros.errors import UsageError
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.results import picture
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall

pytest.importorskip('matplotlib')

TRUTH = np.array([[3.0, 4.0]]) + np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
RED, GREEN, FRAME_RED = (214, 39, 40), (44, 160, 44), (255, 0, 0)


def pixels(content):
    from matplotlib.image import imread

    image = imread(io.BytesIO(content), format='png')
    return (255.0 * image[:, :, :3]).round().astype(int)


def count(image, color):
    return int(np.sum(np.all(abs(image - color) <= 3, axis=2)))


def halves(content):
    image = pixels(content)
    return image[:, :image.shape[1] // 2], image[:, image.shape[1] // 2:]


def test_truth_edges_and_rectangles_are_drawn(mapper):
    assert mapper.estimate.status == 'closed'
    room, beam_map = halves(picture.picture_png(mapper, mapper.estimate, TRUTH))
    assert min(count(room, RED), count(room, GREEN)) > 200
    assert count(beam_map, FRAME_RED) > 100
    assert count(room, FRAME_RED) == 0


def test_without_truth_there_is_no_red_in_the_room(mapper):
    room, _ = halves(picture.picture_png(mapper, mapper.estimate))
    assert count(room, RED) == 0
    assert count(room, GREEN) > 200


def test_the_same_answer_gives_the_same_bytes(mapper):
    assert picture.picture_png(mapper, mapper.estimate) == picture.picture_png(mapper, mapper.estimate)


@pytest.mark.parametrize('estimate', [
    Estimate('ambiguous', 'paper', alternatives=(Candidate(TRUTH, (Edge(1.0, 0.0, 1.0),) * 4),) * 2),
    Estimate('open', 'paper', walls=(Edge(3.5, 0.0, 1.0), Edge(3.9, np.pi / 2, 1.0))),
    Estimate('open', 'paper'),
])
def test_other_answers(mapper, estimate):
    room, beam_map = halves(picture.picture_png(mapper, estimate))
    drawn = bool(estimate.alternatives or estimate.walls)
    assert (count(room, GREEN) > 100) == drawn
    assert (count(beam_map, FRAME_RED) > 0) == bool(estimate.walls)


def test_holes_and_inner_walls_are_drawn(mapper):
    hole = Candidate(np.array([[3.1, 4.1], [3.1, 4.4], [3.4, 4.4], [3.4, 4.1]]),
                     (Edge(3.1, 0.0, 1.0), Edge(-4.4, -np.pi / 2, 1.0), Edge(-3.4, -np.pi, 1.0), Edge(4.1, 1.5, 1.0)))
    seam = InnerWall(np.array([2.6, 3.6]), np.array([3.4, 3.7]), Edge(-3.0, -1.45, 1.0), 0.3, 0.9)
    plain = [count(half, color) for half, color in zip(
        halves(picture.picture_png(mapper, mapper.estimate)), (GREEN, FRAME_RED), strict=True)]
    estimate = dataclasses.replace(mapper.estimate, holes=(hole,), inner_walls=(seam,))
    room, beam_map = halves(picture.picture_png(mapper, estimate))
    assert count(room, GREEN) > plain[0] + 100
    assert count(room, (255, 127, 14)) > 100
    assert count(beam_map, FRAME_RED) > plain[1] + 100


def test_candidates_can_be_told_apart(mapper):
    candidates = [Candidate(TRUTH + shift, (Edge(1.0, 0.0, 1.0),) * 4) for shift in (0.0, 0.3)]
    room, _ = halves(picture.picture_png(mapper, Estimate('ambiguous', 'paper', alternatives=tuple(candidates))))
    assert min(count(room, GREEN), count(room, (255, 127, 14))) > 200


def test_a_mapper_that_has_heard_nothing():
    silent = PolygonMapper(Parameters().replaced({'grid.angle_step_deg': 10.0}))
    silent.solve()
    assert pixels(picture.picture_png(silent, silent.estimate)).shape[2] == 3


def test_matplotlib_missing_says_how_to_get_it(monkeypatch):
    for name in ('matplotlib', 'matplotlib.figure'):  # it may have been imported before
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(UsageError, match=r"pip install 'polymap_ros\[plot\]'"):
        picture.require_matplotlib()


def test_a_matplotlib_that_does_not_start_is_told_before_the_work():
    code = 'from polymap_ros.results.picture import require_matplotlib; require_matplotlib()'
    done = subprocess.run([sys.executable, '-c', code], env={**os.environ, 'MPLBACKEND': 'bogus'}, capture_output=True,
                          text=True, timeout=60, check=False)
    assert 'UsageError: a picture needs matplotlib, which cannot be started: ' in done.stderr.splitlines()[-1]
    assert 'bogus' in done.stderr.splitlines()[-1]
