"""Time zero from the echoes themselves: those of higher order are in their places with one only."""

import dataclasses

import pytest

from polymap_ros.calibration import fit
from polymap_ros.calibration.fit import calibrated_time_zero
from polymap_ros.calibration.session import Tape
from polymap_ros.calibration.stages import Fit, Refusal
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import pings

TOLD_S = 3e-6


def session(scene, told_s=TOLD_S):
    mapper = PolygonMapper(Parameters().replaced({'echo.t0_s': told_s}))
    tape = Tape(mapper)
    for ping, pose in zip(pings(scene), scene.poses, strict=True):
        mistaken = dataclasses.replace(ping, t0_s=told_s)
        mapper.add_pose(mistaken.emission_ns, Pose(*pose.tolist()))
        mapper.add_ping(mistaken)
    mapper.finish()
    return tape.session()


def test_a_wrong_time_zero_is_found_to_a_fraction_of_a_microsecond(monkeypatch):
    monkeypatch.setattr(fit, '_PULSES_OFF', (0.8, 0.3))  # 3 us are 4.5 mm; more rounds reach farther
    found = calibrated_time_zero(session(random_scene(2, 6)))
    assert isinstance(found, Fit)
    assert found.values == {'echo.t0_s': pytest.approx(0.0, abs=2e-7)}
    assert 1e-9 < found.deviations['echo.t0_s'] < 2e-7
    assert found.explained > 0.9


def test_a_straight_path_does_not_tell_it():
    scene = random_scene(2, 6)
    straight = dataclasses.replace(scene, poses=scene.poses[:1] + [[0.01 * k, 0.0, 0.0] for k in range(10)])
    found = calibrated_time_zero(session(straight))
    assert isinstance(found, Refusal)
    assert 'straight' in found.reason


def test_the_direct_wave_tells_it_too():
    heard = session(dataclasses.replace(random_scene(3, 4), faults=Faults(direct_wave=10.0)))
    assert heard.direct_wave_t0() == pytest.approx(0.0, abs=4e-6)
    assert session(random_scene(3, 4)).direct_wave_t0() is None
