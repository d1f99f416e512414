"""What is right where something is inside, judged by hand-made estimates, and how it is told."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.shapes_experiment import ShapeTrial, inside_table, shapes_text
from polymap_ros.evaluation.trials import inside_judged, judged
from polymap_ros.simulation.inside import Partition, RoundHole
from polymap_ros.simulation.scenes import Scene
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall

OUTLINE = np.array([[0.0, 0.0], [1.5, 0.1], [1.4, 1.2], [0.2, 1.0]])
HOLE = np.array([[0.6, 0.4], [0.55, 0.7], [0.9, 0.75], [0.95, 0.45]])  # clockwise
OTHER = np.array([[1.1, 0.9], [1.2, 0.9], [1.15, 0.8]])
START, END = np.array([0.3, 0.2]), np.array([0.3, 0.8])
EDGE = Edge(0.0, 0.0, 1.0)


def scene_with(holes=(), walls=()):
    return Scene('plate', OUTLINE, [[0.2, 0.2, 0.0]], holes=holes,
                 inner_walls=tuple(Partition(*ends, 0.4) for ends in walls))


def ring(corners):
    return Candidate(np.array(corners), (EDGE,) * len(corners))


def estimate_of(holes=(), walls=()):
    inner_walls = tuple(InnerWall(np.array(start), np.array(end), EDGE, 0.4, 0.9) for start, end in walls)
    return Estimate('closed', 'evidence', polygon=ring(OUTLINE), holes=tuple(map(ring, holes)), inner_walls=inner_walls)


def judge(estimate, scene):
    inside, trial = inside_judged(estimate, scene), judged(estimate, scene, 'evidence', 1.0)
    assert trial.right == inside.right  # since the outline is
    return inside


@pytest.mark.parametrize(('found', 'right_holes', 'right'), [
    ([HOLE], 1, True),
    ([np.roll(HOLE, 1, axis=0) + (0.002, 0.001)], 1, True),
    ([HOLE + (0.004, 0.0)], 0, False),
    ([HOLE[:3]], 0, False),
    ([], 0, False),
    ([OTHER, HOLE], 1, False),
])
def test_a_hole_is_right_with_all_of_its_walls_and_no_other(found, right_holes, right):
    inside = judge(estimate_of(found), scene_with([HOLE]))
    assert (inside.n_true_holes, inside.n_holes, inside.right_holes) == (1, len(found), right_holes)
    assert inside.right == right


def octagon(x, y, radius, turn=0.1):
    """Of the circle's area, clockwise."""
    turns = turn - 0.25 * np.pi * np.arange(8)
    reach = radius * np.sqrt(0.25 * np.pi / np.sin(0.25 * np.pi))
    return np.array((x, y)) + reach * np.column_stack((np.cos(turns), np.sin(turns)))


@pytest.mark.parametrize(('found', 'right'), [
    ([octagon(0.7, 0.5, 0.1)], True),
    ([octagon(0.702, 0.502, 0.102)], True),
    ([octagon(0.704, 0.5, 0.1)], False),
    ([octagon(0.7, 0.5, 0.103)], False),  # 6 % of the area
    ([octagon(0.7, 0.5, 0.1), OTHER], False),
    ([], False),
])
def test_a_round_hole_is_right_by_its_area_and_its_middle(found, right):
    inside = judge(estimate_of(found), scene_with([RoundHole(np.array((0.7, 0.5)), 0.1)]))
    assert (inside.n_true_holes, inside.n_holes, inside.right) == (1, len(found), right)


def test_two_holes_in_whichever_order():
    assert judge(estimate_of([OTHER, HOLE]), scene_with([HOLE, OTHER])).right
    assert not judge(estimate_of([HOLE, HOLE]), scene_with([HOLE, OTHER])).right
    assert not judge(estimate_of([HOLE]), scene_with()).right


@pytest.mark.parametrize(('found', 'right'), [
    ([(START, END)], True),
    ([(END, START)], True),
    ([(START + (0.002, 0.1), END + (0.001, 0.1))], True),  # its ends are known less well
    ([(START + (0.004, 0.0), END + (0.004, 0.0))], False),
    ([(START + (0.005, 0.0), END - (0.005, 0.0))], False),  # turned by a degree
    ([(START, END), (START + (0.5, 0.0), END + (0.5, 0.0))], False),
    ([], False),
])
def test_an_inner_wall_is_right_by_its_line(found, right):
    assert judge(estimate_of(walls=found), scene_with(walls=[(START, END)])).right == right


def test_ends_are_told_apart_from_the_line():
    inside = judge(estimate_of(walls=[(END - (0.0, 0.05), START - (0.0, 0.02))]), scene_with(walls=[(START, END)]))
    assert sorted(inside.ends_m) == pytest.approx([0.02, 0.05])


def entry(kind, scene, estimate, **changes):
    trial = dataclasses.replace(judged(estimate, scene, 'evidence', 2.0), **changes)
    return ShapeTrial(kind, trial, True, inside_judged(estimate, scene))


def test_the_table_tells_holes_and_inner_walls_apart(make_trial):
    holed, walled = scene_with([HOLE]), scene_with(walls=[(START, END)])
    trials = [
        entry('hole', holed, estimate_of([HOLE])),
        entry('hole', holed, estimate_of([])),
        entry('seam', walled, estimate_of(walls=[(START, END + (0.0, 0.01))]), cautions=('weak_edge',)),
        entry('seam', walled, estimate_of(), cautions=('unexplained',)),
    ]
    rows = [[cell.strip() for cell in line.strip('|').split('|')] for line in inside_table(trials).splitlines()][2:]
    assert [row[2][:6] for row in rows] == ['1 of 2', '-', '1 of 2']
    assert [row[3][:6] for row in rows] == ['-', '1 of 2', '1 of 2']
    assert [row[4:9] for row in rows] == [['1 of 2', '1', '0', '0', '-'], ['1 of 2', '0', '0', '1', '5.0'],
                                          ['2 of 4', '1', '0', '1', '5.0']]
    assert trials[2].row()['right_inner_walls'] == 1
    assert trials[2].row()['median_end_m'] == pytest.approx(0.005)
    assert {len(each.row()) for each in trials} == {len(trials[0].row())}
    outline = ShapeTrial('l', make_trial(), True, inside_judged(estimate_of(), scene_with()))
    assert shapes_text(trials) == inside_table(trials)
    assert shapes_text([outline, *trials]).count('| all |') == 2
