"""Wrong media and drifting odometry on random scenes: found, named, or refused."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.calibration.diagnosis import diagnosis, doubtful, overrides, warning
from polymap_ros.calibration.fit import calibrated_medium, calibrated_odometry, calibrated_time_zero
from polymap_ros.calibration.focus import background, echo_strength, feet_heard, line_focus, wave_focus
from polymap_ros.calibration.session import Tape
from polymap_ros.calibration.stages import Fit, Refusal
from polymap_ros.cautions import Caution
from polymap_ros.errors import ParameterError
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import MediumParameters, Parameters
from polymap_ros.simulation.doubtful_scenes import KINDS
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import Recipe, mistaken, random_scene
from polymap_ros.simulation.waveforms import pings
from polymap_ros.solvers.estimate import Estimate

SHORT = Recipe(pings=30)


def heard(scene, parameters=None, count=None):
    """A mapper that was fed with a scene, and what it keeps."""
    mapper = PolygonMapper(scene.parameters(parameters or Parameters()))
    tape = Tape(mapper)
    for ping, pose in list(zip(pings(scene), scene.reported_poses().tolist(), strict=True))[:count]:
        mapper.add_pose(ping.emission_ns, Pose(*pose))
        mapper.add_ping(ping)
    mapper.finish()
    return mapper, tape.session()


def speed(medium):
    return float(group_speed(make_medium(medium), 100e3))


def test_a_session_hears_what_the_mapper_heard():
    scene = dataclasses.replace(random_scene(4, 5), faults=Faults(odometry_scale=1.02, yaw_drift_deg_m=1.0))
    parameters = Parameters().replaced({
        'sensor.x_m': 0.03, 'sensor.y_m': -0.02, 'odometry.scale': 1.01, 'odometry.yaw_drift_deg_m': -2.0})
    scene = dataclasses.replace(scene, sensor=parameters.sensor)
    mapper, session = heard(scene, parameters)
    data = session.search(mapper.parameters).data
    places = np.array([(sounding.x, sounding.y) for sounding in mapper.soundings])
    np.testing.assert_allclose(data.positions, places, atol=1e-9)
    np.testing.assert_allclose(session.positions(mapper.parameters), places, atol=1e-9)
    again = [sounding.echo for sounding in session.mapper(mapper.parameters).soundings]
    np.testing.assert_allclose(again, [sounding.echo for sounding in mapper.soundings], atol=1e-6)


def test_nothing_is_left_to_listen_to_where_a_slower_wave_takes_longer_for_the_blanking():
    _, session = heard(random_scene(4, 5), Parameters().replaced({'echo.blanking_m': 2.9}), count=12)
    slower = session.parameters.replaced({'medium.thickness_m': 0.004})
    with pytest.raises(ParameterError, match=r'echo.blanking_m: 2.9 leaves 0 of 12 pings'):
        session.search(slower)
    assert isinstance(calibrated_medium(session, elsewhere=True), Refusal)


def test_without_an_echo_nothing_is_calibrated():
    _, session = heard(random_scene(4, 5), Parameters().replaced({'echo.blanking_m': 2.99}), count=12)
    for fit in (calibrated_medium, calibrated_odometry, calibrated_time_zero):
        refusal = fit(session)
        assert refusal.reason == 'none of 12 pings has an echo that stands out of its noise'
        assert 'grid.range_max_m' in refusal.remedy


def test_a_tape_keeps_the_pings_that_the_mapper_keeps():
    scene = random_scene(1, 4)
    mapper = PolygonMapper(scene.parameters())
    tape = Tape(mapper)
    generator = np.random.default_rng(5)
    first = pings(scene)[0]
    for index in range(500):
        stamp_ns = 10**9 + index * 10**8
        mapper.add_pose(stamp_ns, Pose(*generator.uniform(-0.3, 0.3, 2).tolist()))
        mapper.add_ping(dataclasses.replace(first, stamp_ns=stamp_ns))
    kept = [sounding.stamp_ns for sounding in mapper.soundings]
    session = tape.session()
    assert [sounding.stamp_ns for sounding in session.mapper(mapper.parameters).soundings] == kept
    np.testing.assert_allclose(session.positions(mapper.parameters), [
        (sounding.x, sounding.y) for sounding in mapper.soundings], atol=1e-9)


def test_the_map_is_sharpest_where_the_positions_are_true():
    scene = random_scene(2, 5)
    mapper, session = heard(scene)
    data = session.search(mapper.parameters).data
    strength = echo_strength(data)
    stretched = [dataclasses.replace(data, positions=factor * data.positions) for factor in (0.94, 1.0, 1.06)]
    assert np.argmax([line_focus(each, strength) for each in stretched]) == 1
    assert background(data).min() >= 1.0
    start = Pose(*scene.poses[0].tolist()).inverse()
    lines = polygon_lines(start.apply(scene.vertices))
    lines[:, 1] = np.angle(np.exp(1j * lines[:, 1]))
    lines = lines[np.argsort(lines[:, 1])]
    feet = feet_heard(lines, data.positions)
    sharp = [wave_focus(data, lines, feet, factor * data.positions, data.pulse.carrier)
             for factor in (0.99, 0.997, 1.0, 1.003, 1.01)]
    assert np.argmax(sharp) == 2
    assert sharp[2] > 1.3 * max(sharp[0], sharp[4])  # walls heard from few places hardly blur


@pytest.fixture(scope='module')
def thin_plate():
    """The plate taken 20 % too thin."""
    scene = mistaken(random_scene(2, 4, SHORT), thickness_m=0.0048)
    return heard(scene)


@pytest.fixture(scope='module')
def drifting():
    """An odometry that turns by 2 deg/m and counts 2 % too much."""
    faults = Faults(yaw_drift_deg_m=2.0, odometry_scale=1.02)
    return heard(dataclasses.replace(random_scene(4, 4, SHORT), faults=faults))


def test_the_thickness_is_found_and_named(thin_plate):
    mapper, session = thin_plate
    assert doubtful(mapper.solve())
    fit = diagnosis(session)
    assert fit.values == {'medium.thickness_m': pytest.approx(0.006, rel=1e-4)}
    assert abs(fit.values['medium.thickness_m'] - 0.006) < 3.0 * fit.deviations['medium.thickness_m']
    assert warning(session, fit).code == 'wrong_medium'
    assert '-p medium.thickness_m:=0.00' in warning(session, fit).text
    assert overrides(fit)[0].startswith('-p medium.thickness_m:=0.00')


def test_scale_and_drift_are_found_and_named(drifting):
    mapper, session = drifting
    mapper.configure(mapper.parameters.replaced({'slam.mode': 'off'}))
    assert doubtful(mapper.solve())
    fit = calibrated_odometry(session)
    assert fit.values['odometry.scale'] == pytest.approx(1.02, abs=5e-4)
    assert fit.values['odometry.yaw_drift_deg_m'] == pytest.approx(2.0, abs=0.02)
    caution = warning(session, fit)
    assert caution.code == 'wrong_odometry'
    assert 'only the ratio' in caution.text  # a medium scaled by as much sounds the same
    corrected = session.mapper(mapper.parameters.replaced(fit.values)).solve()
    assert (corrected.status, corrected.cautions) == ('closed', ())


def test_steel_taken_for_aluminium_takes_two_numbers():
    scene = dataclasses.replace(random_scene(4, 4, SHORT), told_medium=MediumParameters(
        longitudinal_speed_m_s=5960.0, shear_speed_m_s=3235.0))
    _, session = heard(scene)
    fit = calibrated_medium(session)
    assert set(fit.values) == {'medium.thickness_m', 'medium.shear_speed_m_s'}
    found = session.parameters.replaced(fit.values).medium
    assert speed(found) / speed(scene.medium) == pytest.approx(1.0, abs=1e-3)


def test_nothing_is_wrong_where_what_was_given_is_the_sharpest():
    _, session = heard(random_scene(2, 4, SHORT))
    assert calibrated_medium(session, elsewhere=True).as_given
    assert calibrated_odometry(session, elsewhere=True).as_given


def test_a_straight_path_and_too_few_pings_are_refused_with_the_reason():
    _, straight = heard(KINDS['straight'].make(2, 4).scene)
    assert calibrated_medium(straight).remedy == 'drive a turn'
    _, few = heard(random_scene(2, 4), count=5)
    assert 'at least 8' in calibrated_odometry(few).reason
    envelopes = random_scene(2, 4)
    _, session = heard(envelopes, Parameters().replaced({'echo.kind': 'envelope'}))
    assert 'envelope' in calibrated_medium(session).reason


def test_only_doubt_is_a_reason_to_look():
    def answer(*codes, method='evidence'):
        return Estimate('open', method, cautions=tuple(Caution(code, '') for code in codes))

    assert doubtful(answer('incoherent'))
    assert not doubtful(answer())
    assert not doubtful(answer('straight_path', 'not_closed'))
    assert not doubtful(answer('unexplained', method='paper'))


def test_of_a_constant_speed_only_the_ratio_to_the_odometry_is_known():
    scene = random_scene(2, 4)
    _, session = heard(scene, None)
    session.parameters = session.parameters.replaced({'medium.model': 'constant', 'medium.speed_m_s': 400.0})
    text = warning(session, Fit({'medium.speed_m_s': 340.0}, {'medium.speed_m_s': 0.1}, 0.99, 1.0)).text
    assert 'odometry.scale of 0.85' in text
