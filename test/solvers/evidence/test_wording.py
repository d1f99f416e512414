"""An open answer says the likely cause and the next thing to do, and no cause hides behind another one's remedy."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.cautions import CAUTIONS
from polymap_ros.hearing.pulse_shape import PulseShape
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.solvers.evidence import wording

PULSE = PulseShape(step_m=0.05, carrier=0.0, baseband=np.empty(0), curvature=np.empty(0), power=np.empty(0),
                   width_m=0.03)


def pings(count=40, span_m=1.0, with_echo=1.0, listened_m=(0.0, 3.0)):
    """Pings along a line, of which the first have an echo that stands out."""
    first, end = (round(at / PULSE.step_m) for at in listened_m)
    echo, envelope = np.zeros(100, np.complex64), np.ones(4, np.float32)
    echo[first:end] = 1.0
    heard = [Sounding(k, x, 0.0, echo, envelope, rho=0.4) for k, x in enumerate(np.linspace(0.0, span_m, count))]
    first = round(with_echo * count)
    return [*heard[:first], *(dataclasses.replace(each, rho=np.nan) for each in heard[first:])]


@pytest.mark.parametrize(('walls', 'enclosing', 'heard', 'code', 'finding', 'remedy'), [
    (0, False, pings(with_echo=0.0), 'no_free_area', 'none of 40 pings has an echo', 'the sensor is on'),
    (0, False, pings(with_echo=0.0, listened_m=(2.9, 3.0)), 'no_free_area',
     'none of 40 pings has an echo that stands out of its noise: only what is 2.9 m to 2.95 m away is listened to',
     'lower echo.blanking_m'),
    (0, False, pings(with_echo=0.0, listened_m=(3.0, 3.0)), 'no_free_area',
     'none of 40 pings has an echo that stands out of its noise: echo.blanking_m leaves nothing',
     'lower echo.blanking_m'),
    (1, False, pings(with_echo=0.1, listened_m=(1.0, 3.0)), 'not_closed',
     '1 wall is certain, too few to enclose an area: only what is 1 m to 2.95 m away', 'lower echo.blanking_m'),
    (2, False, pings(listened_m=(0.0, 0.25)), 'not_closed', '2 walls are certain, too few to enclose an area: nothing '
     'beyond 0.2 m is listened to, and the path alone spans 1 m', 'raise grid.range_max_m'),
    (5, True, pings(), 'not_closed', '5 walls are certain, but solver.max_edges allows 4', 'raise solver.max_edges'),
    (4, True, pings(), 'not_closed', '4 walls are certain and enclose an area', 'points inwards'),
    (1, False, pings(with_echo=0.4), 'not_closed', '1 wall is certain, too few to enclose an area: 16 of 40', 'louder'),
    (0, False, pings(span_m=0.05), 'not_closed', 'no wall is certain: the path spans 50 mm only', 'drive further'),
    (0, False, pings(count=8), 'not_closed', 'no wall is certain: 8 pings tell little', 'go on pinging'),
    (2, False, pings(), 'not_closed', '2 walls are certain, too few to enclose an area: the others', 'walls that are'),
    (0, False, pings(), 'not_closed', 'no wall is certain: the echoes of different places do not', '--fit-odometry'),
])
def test_the_cause_and_what_to_do(walls, enclosing, heard, code, finding, remedy):
    caution = wording.nothing_closes(walls, enclosing, 4, heard, PULSE)
    assert caution.code == code
    assert caution.finding.startswith(finding)
    assert remedy in caution.remedy


@pytest.mark.parametrize('walls', [0, 2])
def test_on_a_straight_path_the_remedy_is_a_turn(walls):
    caution = wording.nothing_closes(walls, False, 4, pings(), PULSE, straight=True)
    assert (caution.code, caution.remedy) == ('not_closed', CAUTIONS['straight_path'].remedy)
    assert 'mirror images' in caution.finding
    silent = wording.nothing_closes(walls, False, 4, pings(with_echo=0.4), PULSE, straight=True)
    assert 'louder' in silent.remedy  # which no turn mends


def test_gaps_in_a_polygon():
    assert wording.edges_unheard(1, 4).finding == '1 of the 4 edges that would close the polygon was not heard'
    assert wording.edges_unheard(2, 5).finding == '2 of the 5 edges that would close the polygon were not heard'
    far = wording.corner_too_far(7123.4)
    assert far.text.startswith('the walls would meet 7123 m away from every ping, beyond what can be heard; drive')
    assert all(caution.code == 'not_closed' for caution in (far, wording.corner_cut_off(), wording.edges_unheard(1, 3)))


def test_edges_and_corners_are_named():
    assert wording.weak_edges(['2']).finding == 'edge 2 is likely, but not certain'
    assert wording.weak_edges(['0', 'H0.3']).finding == 'edges 0, H0.3 are likely, but not certain'
    assert wording.corners_unheard({4: 0.15, 1: 0.0074}).finding.startswith(
        'no echo has been near corner 1 (up to 7 mm of it), 4 (up to 0.15 m of it): ')


def test_what_a_path_tells():
    text = wording.odometry_drift(0.0981, -0.18, 8.3).text
    assert 'off by 98.1 mm and -10.3 deg at the end of 8.3 m' in text
    slips = wording.slips([(12.5, 0.05, np.deg2rad(5.0)), (20.0, 0.2, 0.0), (21.0, 0.2, 0.0), (22.0, 0.2, 0.0)])
    assert 'by 50 mm and +5.0 deg at 12.5 s' in slips.finding
    assert slips.finding.endswith('at 21.0 s and 1 times more')
    assert wording.lost(3, 60, 7.25).finding == '3 of 60 pings fit no place between the walls, the first at 7.2 s'


def test_what_is_unexplained():
    assert wording.unexplained(0.433, 4, 10).text == (
        f"the polygon explains 43% of the echoes' power; {CAUTIONS['unexplained'].remedy}")
    assert wording.unexplained(-0.1, 4, 4).finding.startswith('the polygon explains 0% of')
