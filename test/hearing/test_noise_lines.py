"""Lines of other machines are taken out of the pings and told; a plate is mapped as without them."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.errors import StateError
from polymap_ros.evaluation.trials import feed
from polymap_ros.hearing.noise_lines import NoiseLines
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import pings


def after(*pings):
    found = NoiseLines()
    for lines_hz in pings:
        found = found.taken(lines_hz)
    return found


def test_the_lines_of_a_machine_are_one_and_what_came_by_is_not_told():
    found = after((90e3,), (90.9e3, 40e3), (89.5e3, 120e3), *[(90e3,)] * 8, ())
    assert found.known_hz == pytest.approx([90.04e3], rel=1e-3)
    [caution] = found.cautions
    assert caution.code == 'noise_line'
    assert '12 pings hold 9.004e+04 Hz in 11 of them' in caution.finding
    assert after((), (40e3,), ()).cautions == after().cautions == ()


def test_the_commonest_are_kept():
    found = after(*([(7e4, float(hz)) for hz in np.geomspace(1e4, 6e4, 60)]))
    assert len(found.counts) == 32
    assert found.frequency_hz[0] == pytest.approx(7e4)
    assert found.counts[0] == 60


def test_impulses_are_told_with_their_share():
    found = NoiseLines()
    for struck in (0.02, 0.0, 0.04, 0.03):
        found = found.taken((), struck)
    [caution] = found.cautions
    assert caution.code == 'impulses'
    assert caution.finding.startswith('3 of 4 pings hold impulses, on 3.00% of their samples')


def test_a_state_goes_on():
    found = after((90e3,), (90e3, 40e3)).taken((), 0.25)
    again = NoiseLines.restored(found.state())
    np.testing.assert_array_equal(again.frequency_hz, found.frequency_hz)
    np.testing.assert_array_equal(again.counts, found.counts)
    assert (again.pings, again.struck_pings, again.struck) == (3, 1, 0.25)


@pytest.mark.parametrize('wrong', [
    {'pings': np.array(-1)}, {'counts': np.ones(3)}, {'counts': np.zeros(2)}, {'frequency_hz': np.array([1.0, np.nan])},
    {'frequency_hz': np.ones((2, 1)), 'counts': np.ones((2, 1))},
    {'frequency_hz': np.ones(40), 'counts': np.ones(40)}, {'struck': np.ones(3)}, {'struck': np.array([-1.0, 0.0])}])
def test_no_lines_of_pings_are_refused(wrong):
    with pytest.raises(StateError, match='of pings'):
        NoiseLines.restored(after((90e3, 40e3)).state() | wrong)


@pytest.mark.parametrize(('faults', 'told'), [
    ({'lines': 1, 'line_hz': 91e3}, ['noise_line']), ({'lines': 1, 'line_hz': 35e3, 'line_db': 10.0}, ['noise_line']),
    ({'impulses': 0.02}, ['impulses'])])
def test_a_plate_is_mapped_and_only_that_is_told(faults, told):
    scene = dataclasses.replace(random_scene(13, 4), faults=Faults(**faults))
    mapper = PolygonMapper(scene.parameters())
    feed(mapper, scene)
    answer = mapper.solve()
    assert [each.code for each in answer.cautions] == told
    at = [np.linalg.norm(answer.polygon.vertices - corner, axis=1).min() for corner in scene.vertices]
    assert max(at) < 5e-4
    again = PolygonMapper.from_state(mapper.parameters, mapper.state())
    np.testing.assert_array_equal(again.state()['lines.counts'], mapper.state()['lines.counts'])
    signals = mapper.signals(pings(scene)[0])
    assert 'without impulses and lines' in [label for label, _ in signals.steps]
