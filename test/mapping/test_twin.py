"""What lets the node answer at once: pings that wait for their filter, and twins that are solved elsewhere."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import pings

PARAMETERS = Parameters().replaced({'solver.method': 'paper'})


@pytest.fixture(scope='module')
def ride():
    """(pose, ping) of a triangular plate; every third ping is shorter."""
    scene = load_scene('triangle')
    heard = [dataclasses.replace(ping, samples=ping.samples[:1500] if k % 3 == 2 else ping.samples)
             for k, ping in enumerate(pings(scene))]
    return [(Pose(*pose), ping) for pose, ping in zip(scene.poses, heard, strict=True)]


def feed(mapper, ride):
    for pose, ping in ride:
        mapper.add_pose(ping.emission_ns, pose)
        mapper.add_ping(ping)


def same(one, other):
    first, second = one.state(), other.state()
    return first.keys() == second.keys() and all(np.array_equal(first[name], second[name]) for name in first)


def answer(estimate):
    return estimate.status, estimate.cost, estimate.polygon.vertices.tolist()


def test_pings_wait_for_their_filter_in_order_and_give_the_same_map(ride):
    jobs = []
    mapper = PolygonMapper(PARAMETERS, later=jobs.append)
    feed(mapper, ride[:4])
    assert (mapper.counts.used, mapper.counts.waiting, len(jobs)) == (0, 4, 1)
    jobs.pop()()
    mapper.go_on()
    assert (mapper.counts.used, mapper.counts.waiting, len(jobs)) == (2, 2, 1), 'the third has another length'
    feed(mapper, ride[4:8])
    assert (mapper.counts.used, mapper.counts.waiting, len(jobs)) == (2, 6, 1)
    jobs.pop()()
    mapper.go_on()
    feed(mapper, ride[8:])
    assert (mapper.counts.used, mapper.counts.waiting, jobs) == (len(ride), 0, [])
    at_once = PolygonMapper(PARAMETERS)
    feed(at_once, ride)
    assert same(mapper, at_once)


def test_a_mapper_that_is_held_loses_nothing_and_goes_on_to_the_same_map(ride):
    mapper, at_once = PolygonMapper(PARAMETERS), PolygonMapper(PARAMETERS)
    mapper.intake.held = True
    feed(mapper, ride)
    assert (mapper.counts.used, mapper.counts.waiting) == (0, len(ride))
    saved = PolygonMapper.from_state(PARAMETERS, mapper.twin().state())
    saved.intake.resuming = False
    mapper.intake.held = False
    for each in (mapper, saved):
        each.go_on()
    feed(at_once, ride)
    assert same(mapper, at_once)
    assert same(saved, at_once)


def test_pings_that_have_waited_are_used_a_few_at_a_time(ride):
    late, early = PolygonMapper(PARAMETERS, at_most=4), PolygonMapper(PARAMETERS)
    for each in (late, early):
        each.add_pose(0, Pose(0.5, 0.3))
        for k in range(9):
            each.add_ping(dataclasses.replace(ride[k][1], stamp_ns=k + 1, samples=ride[0][1].samples + 1e-3 * k))
        each.add_pose(10**6, Pose(0.6, 0.3))
    used = [late.counts.used]
    while late.intake.behind:
        late.go_on()
        used.append(late.counts.used)
    assert used == [4, 8, 9]
    assert same(late, early)


def test_what_is_added_to_a_mapper_does_not_reach_its_twin(ride):
    mapper, reference = PolygonMapper(PARAMETERS), PolygonMapper(PARAMETERS)
    feed(mapper, ride[:20])
    feed(reference, ride[:20])
    mapper.drop('paused')
    reference.drop('paused')
    twin = mapper.twin()
    feed(mapper, ride[20:])
    mapper.drop('paused')
    assert same(twin, reference)
    assert answer(twin.solve()) == answer(reference.solve())
    assert mapper.estimate is None
    feed(twin, ride[20:])
    feed(reference, ride[20:])
    assert same(twin, reference)


def test_a_reset_and_a_change_of_parameters_leave_a_solve_of_the_twin_alone(ride):
    mapper, reference = PolygonMapper(PARAMETERS), PolygonMapper(PARAMETERS)
    feed(mapper, ride)
    feed(reference, ride)
    expected = answer(reference.solve())
    for change in (PolygonMapper.reset, lambda each: each.configure(PARAMETERS.replaced({'solver.iterations': 5}))):
        twin = mapper.twin()
        assert answer(twin.solve(lambda change=change: change(mapper))) == expected
        mapper.reset()
        mapper.configure(PARAMETERS)
        feed(mapper, ride)
