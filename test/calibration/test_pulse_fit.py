"""A transducer that rings: its pulse, and the walls, against what was simulated."""

import dataclasses
import json

import numpy as np
import pytest
from heard_scenes import feed

from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import RecordedPulse
from polymap_ros.calibration.pulse_fit import FittedPulse, fitted_pulse
from polymap_ros.calibration.session import Tape
from polymap_ros.calibration.stages import Refusal
from polymap_ros.commands import replay
from polymap_ros.commands.simulate import record
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.waveforms import emitted, simulate


def taped(scene, **changes):
    mapper = PolygonMapper(scene.parameters(Parameters().replaced(changes)))
    tape = Tape(mapper)
    feed(mapper, scene, simulate(scene).astype(np.float32))
    return tape.session()


def test_the_pulse_of_a_transducer_is_found_and_the_walls_with_it():
    scene = VARIANTS['q_5'].make(104, 4)
    session = taped(scene)
    found = fitted_pulse(session)
    assert found.explained > 0.98
    true = emitted(scene).samples(scene.period_s)
    shape = found.recorded.recorded
    true = np.pad(true, (0, max(len(shape) - len(true), 0)))[:len(shape)]
    assert np.corrcoef(shape, true)[0, 1] > 0.98  # and not turned, which the coefficients could take in
    mapper = PolygonMapper(scene.parameters(Parameters()), found.recorded)
    feed(mapper, scene, simulate(scene).astype(np.float32))
    answer = mapper.solve()
    off = compare(answer.polygon.vertices, scene.vertices)
    assert off.right
    assert np.max(np.abs(off.offsets_m)) < 2e-4
    assert answer.cautions == ()


def test_what_has_no_pulse_or_no_walls_is_refused_by_name():
    scene = dataclasses.replace(VARIANTS['plate'].make(104, 4), poses=VARIANTS['plate'].make(104, 4).poses[:12])
    assert 'magnitudes' in fitted_pulse(taped(scene, **{'echo.kind': 'envelope'})).reason
    noise = dataclasses.replace(scene, snr_db=-60.0)
    refused = fitted_pulse(taped(noise))
    assert isinstance(refused, Refusal)


def test_a_replay_writes_the_pulse_which_the_next_one_takes(tmp_path, capsys):
    scene = VARIANTS['q_5'].make(104, 4)
    record(scene, tmp_path / 'run.mcap')
    first, second = tmp_path / 'first', tmp_path / 'second'
    assert replay.main([str(tmp_path / 'run.mcap'), '--output', str(first), '--fit-pulse']) == 0
    out = capsys.readouterr().out
    assert 'pulse_adapted' in out
    assert 'right' in out
    pulse = np.load(first / 'pulse.npy')
    assert RecordedPulse(pulse, scene.period_s).duration_s < 2e-4
    given = ['-p', 'pulse.kind:=file', '-p', f'pulse.path:={first / "pulse.npy"}']
    assert replay.main([str(tmp_path / 'run.mcap'), '--output', str(second), *given]) == 0
    assert 'warning' not in capsys.readouterr().out
    walls = [[edge['r'] for edge in json.loads((folder / 'polygon.json').read_text())['edges']]
             for folder in (first, second)]
    np.testing.assert_allclose(*walls, atol=1e-6)


@pytest.mark.parametrize('fault', ['near', 'quiet', 'short', 'outside'])
def test_pings_by_which_nothing_can_be_fitted_are_no_error(fault):
    """Beside a wall, silent but for noise, cut short, or outside of what the first search finds."""
    scene = VARIANTS['q_5'].make(104, 4)
    samples, poses = simulate(scene).astype(np.float32)[:14], scene.poses[:14].copy()
    if fault == 'near':
        poses[3, :2] += 0.98 * (scene.vertices[:2].mean(axis=0) - poses[3, :2])
    elif fault == 'quiet':
        samples = np.random.default_rng(1).normal(size=samples.shape).astype(np.float32)
    elif fault == 'short':
        samples = samples[:, :260]
    else:
        poses[5, :2] += 3.0
    mapper = PolygonMapper(scene.parameters(Parameters()))
    tape = Tape(mapper)
    for stamp_ns, (pose, row) in enumerate(zip(poses.tolist(), samples, strict=True)):
        mapper.add_pose(stamp_ns, Pose(*pose))
        mapper.add_ping(Ping(stamp_ns, row, scene.period_s))
    assert isinstance(fitted_pulse(tape.session()), Refusal | FittedPulse)


def test_it_is_asked_for_alone(capsys):
    assert replay.main(['none', '--fit-pulse', '--calibrate']) == 2
    assert '--fit-pulse is not for a run with --calibrate' in capsys.readouterr().err
