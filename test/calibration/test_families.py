"""Families of media: their speeds, and what echoes look like from a point nearby, against synthesised ones."""

import numpy as np
import pytest

from polymap_ros.acoustics.matched_filter import MatchedFilter
from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.calibration.families import Odometry, Plate, Speed, Thickness
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.waveforms import Synthesis

PARAMETERS = Parameters()
AIR = PARAMETERS.replaced({'medium.model': 'constant', 'pulse.frequency_hz': 20e3})
FAMILIES = {
    'thickness': (Thickness(PARAMETERS), np.array([0.03])),
    'plate': (Plate(PARAMETERS), np.array([0.012, -0.008])),
    'speed': (Speed(AIR), np.array([0.015])),
}


def speeds(parameters):
    medium, frequency = make_medium(parameters.medium), parameters.pulse.frequency_hz
    return float(group_speed(medium, frequency)), 2.0 * np.pi * frequency / float(
        medium.wavenumber(2.0 * np.pi * frequency))


def test_a_plate_is_found_from_the_speeds_of_steel():
    """Speeds from an independent solution of the Rayleigh-Lamb equation: steel, 6 mm, 100 kHz."""
    plate = Plate(PARAMETERS)
    found = plate.values(np.log((3059.190, 2023.260)))
    np.testing.assert_allclose(speeds(PARAMETERS.replaced(found)), (3059.190, 2023.260), rtol=1e-8)
    assert found['medium.thickness_m'] == pytest.approx(0.006, rel=0.02)
    assert found['medium.shear_speed_m_s'] == pytest.approx(3235.0, rel=0.01)


def test_no_plate_has_a_phase_speed_beyond_all_speeds():
    assert Plate(PARAMETERS).values(np.log((3000.0, 20000.0))) is None


@pytest.mark.parametrize('name', FAMILIES)
def test_given_parameters_are_at_the_given_point(name):
    family, _ = FAMILIES[name]
    values = family.values(family.given)
    assert values == pytest.approx({name: family.parameters[name] for name in values})


@pytest.mark.parametrize('name', FAMILIES)
def test_an_echo_seen_from_nearby_is_where_and_as_turned_as_the_view_says(name):
    """Synthesised in the medium of q, filtered with that of p: two ranges give the zoom, and the carrier."""
    family, offset = FAMILIES[name]
    p, q = family.given, family.given + offset
    base = family.parameters
    here, there = (base.replaced(family.values(point)) for point in (p, q))
    period_s, n = 0.1 / base.pulse.frequency_hz, 4096
    pulse = make_pulse(base.pulse, None, period_s)
    scale = speeds(base)[0] * n * period_s / 4.0
    ranges = np.arange(4001) * (scale * 2.0 / 4000.0)
    heard = MatchedFilter(make_medium(here.medium), pulse, ranges, n, period_s)
    synthesis = Synthesis(make_medium(there.medium), pulse, n, period_s)
    distances = scale * np.array((0.5, 0.7))
    view = family.view(p, q)
    correlations = [heard(synthesis(np.array([2.0 * d]), np.array([1.0]))) for d in distances]
    tops = np.array([ranges[np.argmax(np.abs(c))] for c in correlations])
    assert tops[1] - tops[0] == pytest.approx((distances[1] - distances[0]) / view.zoom, abs=2.0 * ranges[1])
    # Turned by the view's carrier, the echoes of both walls have one phase, as those of one wall must have.
    carrier = speeds(here)[1]
    k = 2.0 * np.pi * base.pulse.frequency_hz / carrier
    turned = []
    for d, correlation in zip(distances / view.zoom, correlations, strict=True):
        value = np.interp(d, ranges, (correlation * np.exp(-2j * k * ranges)))
        turned.append(np.angle(value * np.exp(2j * (k + view.carrier) * d)))
    # The pulse's asymmetric spectrum leaves a little; without the carrier it would be more than a radian.
    assert abs(np.angle(np.exp(1j * (turned[1] - turned[0])))) < 0.15
    assert abs(2.0 * view.carrier * (distances[1] - distances[0])) > 1.0 or name == 'speed'


def test_the_odometry_begins_with_what_is_given():
    parameters = PARAMETERS.replaced({'odometry.scale': 1.02, 'odometry.yaw_drift_deg_m': -1.0})
    family = Odometry(parameters)
    assert family.values(family.given) == pytest.approx({'odometry.scale': 1.02, 'odometry.yaw_drift_deg_m': -1.0})
    assert any(np.allclose(point, family.given) for point in family.near(family.given))


def test_a_medium_beyond_what_is_allowed_is_none():
    plate = Plate(PARAMETERS.replaced({'medium.thickness_m': 1.0}))
    assert plate.values(plate.given) == pytest.approx({'medium.thickness_m': 1.0, 'medium.shear_speed_m_s': 3097.0})
    assert plate.values(plate.given + 0.5) is None
