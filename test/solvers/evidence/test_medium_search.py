"""Media that get faster, or are faster in one direction: ways by the simulator's legs, not by the solver's plane."""

import dataclasses
import re

import numpy as np
import pytest
from heard_scenes import solved

from polymap_ros.errors import StateError
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.propagation import Propagation
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.solver import EvidenceSolver
from polymap_ros.solvers.evidence.uneven_medium import UnevenMedium


@pytest.fixture(scope='module')
def scene():
    return random_scene(4, 5)


@pytest.mark.parametrize(('waves', 'told', 'percent'), [
    (Propagation(speed_drift=0.01), 'from the first ping to the last waves got faster', 1.0),
    (Propagation(speed_drift=-0.005), 'from the first ping to the last waves got slower', 0.5),
    (Propagation(anisotropy=0.01, anisotropy_deg=30.0), 'waves are faster', 1.0),
])
def test_a_medium_that_is_not_even_is_found_and_told(scene, waves, told, percent):
    uneven = dataclasses.replace(scene, propagation=waves)
    solver, mapper, answer = solved(uneven)
    assert [each.code for each in answer.cautions] == ['medium_uneven']
    number, = re.findall(told + r' by ([0-9.]+)%', str(answer.cautions[0]))
    assert float(number) == pytest.approx(percent, rel=0.04)
    off = compare(mapper.solve().polygon.vertices, uneven.vertices)
    assert off.right
    assert np.max(np.abs(off.offsets_m)) < 2e-4
    again = EvidenceSolver(mapper.parameters)
    again.restore(solver.state())
    restored = again.solve(mapper.evidence)
    assert [each.code for each in restored.cautions] == ['medium_uneven']
    np.testing.assert_allclose(restored.polygon.vertices, answer.polygon.vertices, atol=1e-4)


def test_the_direction_is_told_from_edge_0(scene):
    rolled = Propagation(anisotropy=0.02, anisotropy_deg=30.0)
    _, mapper, answer = solved(dataclasses.replace(scene, propagation=rolled))
    polygon = mapper.solve().polygon
    ahead = np.subtract(polygon.vertices[1], polygon.vertices[0])
    from_edge = np.rad2deg(np.deg2rad(30.0) - np.arctan2(ahead[1], ahead[0])) % 180.0
    assert f'at {from_edge:.0f} deg from edge 0' in str(answer.cautions[0])


def test_an_even_medium_is_left(scene):
    solver, _, answer = solved(scene)
    assert answer.cautions == ()
    assert 'medium_uneven' not in solver.state()


def test_a_faster_ping_is_drawn_out_to_what_it_would_have_been(scene):
    """Against the same plate heard by the simulator in an even medium."""
    quiet = dataclasses.replace(scene, snr_db=None)
    mapper = filled_mapper(dataclasses.replace(quiet, propagation=Propagation(speed_drift=0.02)), Parameters())
    even = filled_mapper(quiet, Parameters())
    stamps_ns = np.array([each.stamp_ns for each in mapper.evidence.heard])
    seconds = np.ptp(stamps_ns) / 1e9
    data, true = (search_of(each.evidence, each.parameters).data for each in (mapper, even))
    heard = UnevenMedium(int(stamps_ns[0]), per_s=0.02 / seconds).heard(data, stamps_ns)

    def agreement(one, other):
        a, b = one.signal[-1, :2400], other.signal[-1, :2400]
        return abs(np.vdot(a, b)) / np.linalg.norm(a) / np.linalg.norm(b)

    assert agreement(heard, true) > 0.97 > 0.5 > agreement(data, true)


@pytest.mark.parametrize('damage', [np.array((np.nan, 0.0, 0.0, 0.0, 0.0)), np.zeros(3),
                                    np.array((0.0, 0.2, 0.0, 0.0, 0.0))])
def test_a_damaged_medium_of_a_saved_state_is_refused(damage):
    medium = UnevenMedium(5, 1e-4, 0.01, -0.005, 1e-6, 1e-5)
    assert UnevenMedium.restored(medium.state()) == medium
    with pytest.raises(StateError, match='the medium that was found'):
        UnevenMedium.restored(medium.state() | {'medium_uneven': damage})
