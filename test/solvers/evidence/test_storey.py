"""Floor and ceiling: found from what all pings hear, and told; not where there are none."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.parameters import Parameters, SensorParameters
from polymap_ros.simulation.height import Height
from polymap_ros.simulation.random_scenes import air_filled, random_scene, storeyed
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.storey_heard import storey_heard


def heard(scene):
    """Heights and coefficients of the planes that the scene's pings hear, before anything else is known."""
    mapper = filled_mapper(scene, Parameters())
    return storey_heard(search_of(mapper.evidence, mapper.parameters).data)[0]


@pytest.fixture(scope='module')
def room():
    return storeyed(air_filled(random_scene(2, 5)))


def test_heights_are_heard_before_any_wall_is_known(room):
    found = heard(room)
    assert found.height_m == pytest.approx([room.height.floor_m, room.height.ceiling_m], abs=0.002)


def test_what_one_plane_alone_reflects_is_one_plane(room):
    for only in ({'ceiling_m': 0.0}, {'floor_m': 0.0}):
        scene = dataclasses.replace(room, height=dataclasses.replace(room.height, **only))
        assert heard(scene).height_m == pytest.approx(scene.height.storey.height_m, abs=0.002)


@pytest.mark.parametrize('seed', [2, 4])
def test_where_there_are_none_none_are_told(seed):
    """Although between walls that are nearly parallel an echo comes from one range everywhere, as a ceiling's does."""
    scene = dataclasses.replace(storeyed(air_filled(random_scene(seed, 5))), height=Height())
    assert len(heard(scene)) == (seed == 2)
    estimate = filled_mapper(scene, Parameters()).solve()
    assert compare(estimate.polygon.vertices, scene.vertices, 0.01).right
    assert not estimate.cautions
    assert len(estimate.storey) == 0


def test_a_room_with_both_is_right_and_not_doubted(room):
    estimate = filled_mapper(room, Parameters()).solve()
    assert estimate.status == 'closed'
    assert not estimate.cautions
    assert compare(estimate.polygon.vertices, room.vertices, 0.01).right
    assert estimate.storey.height_m == pytest.approx([room.height.floor_m, room.height.ceiling_m], abs=1e-4)
    true = [room.height.floor_reflection, room.height.ceiling_reflection]
    assert estimate.storey.reflection == pytest.approx(true, abs=0.03)


@pytest.mark.parametrize('sensor', [
    SensorParameters(baseline_z_m=0.08), SensorParameters(baseline_z_m=-0.3), SensorParameters(baseline_x_m=0.2),
], ids=['above', 'below', 'beside'])
def test_heights_are_those_from_the_emitter_wherever_the_receiver_is(room, sensor):
    found = heard(dataclasses.replace(room, sensor=sensor))
    assert found.height_m == pytest.approx([room.height.floor_m, room.height.ceiling_m], abs=0.002)


def test_a_receiver_above_the_emitter_is_taken_into_account(room):
    scene = dataclasses.replace(room, sensor=SensorParameters(baseline_z_m=0.08))
    estimate = filled_mapper(scene, Parameters()).solve()
    assert compare(estimate.polygon.vertices, scene.vertices, 0.01).right
    assert np.all(np.abs(estimate.storey.height_m - [scene.height.floor_m, scene.height.ceiling_m]) < 0.01)
