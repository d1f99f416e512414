"""Samples about another value than 0, such as counts without a sign, are heard as those about 0, and that is told."""

import numpy as np
import pytest
from scipy.signal import hilbert

from polymap_ros.acoustics.front_end import drifts, has_offset
from polymap_ros.acoustics.ping import Ping
from polymap_ros.cautions import causes
from polymap_ros.errors import BadPing
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.listening import Listener
from polymap_ros.hearing.offsets import Offsets
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

SCENE = load_scene('triangle')
SAMPLES = simulate(SCENE)


def mapped(samples, **changes):
    mapper = PolygonMapper(Parameters().replaced(changes))
    for k, (pose, row) in enumerate(zip(SCENE.poses, samples, strict=False)):
        mapper.add_pose(k, Pose(*pose))
        mapper.add_ping(Ping(k, row.astype(np.float32), SCENE.period_s))
    return mapper


def cautions_of(samples, **changes):
    """What is told of the offsets of pings."""
    offsets, parameters = Offsets(), Parameters().replaced(changes)
    for row in samples:
        offsets = offsets.taken(row.astype(np.float32), parameters)
    return offsets.cautions


def test_counts_of_a_converter_without_a_sign_give_the_same_walls():
    drifting = 2048 + 300 * np.sin(np.arange(len(SAMPLES)))[:, None]
    counts = np.round(200.0 * SAMPLES / np.abs(SAMPLES).max() + drifting)
    mapper = mapped(counts)
    answer, expected = mapper.solve(), mapped(SAMPLES).solve()
    np.testing.assert_allclose(answer.polygon.vertices, expected.polygon.vertices, atol=2e-5)
    assert [caution.code for caution in expected.cautions] == []
    [told] = answer.cautions
    assert told.code == 'dc_offset'
    assert f'{len(SAMPLES)} of {len(SAMPLES)} pings have an offset, on average 20' in told.text
    assert 'front_end.remove_dc: true' in told.text
    assert 'echo.kind: envelope' in told.text
    again = PolygonMapper.from_state(mapper.parameters, mapper.state())
    np.testing.assert_array_equal(again.state()['offsets.sums'], mapper.state()['offsets.sums'])


@pytest.mark.parametrize('kind', ['rf', 'envelope'])
def test_what_is_taken_out_anyway_is_not_told(kind):
    changes = {'echo.kind': kind, 'front_end.remove_dc': True}
    assert cautions_of(np.abs(SAMPLES[:3]) + 5.0, **changes) == ()


def test_a_floor_below_magnitudes_is_taken_out_and_told():
    magnitudes = 200.0 * np.abs(hilbert(SAMPLES, axis=1)) / np.abs(SAMPLES).max()
    blanked = np.where(np.arange(SAMPLES.shape[1]) < 20, 0.0, magnitudes + 300.0)
    mapper, plain = (mapped(rows, **{'echo.kind': 'envelope'}) for rows in (blanked, magnitudes))
    assert cautions_of(magnitudes, **{'echo.kind': 'envelope'}) == ()
    [told] = cautions_of(blanked, **{'echo.kind': 'envelope'})
    assert told.code == 'dc_offset'
    assert f'{len(SAMPLES)} of {len(SAMPLES)} pings have an offset, on average 299.7' in told.text
    assert mapper.free_area.area > 0.0
    closest = [[sounding.rho for sounding in each.soundings] for each in (mapper, plain)]
    assert np.mean(np.abs(np.subtract(*closest)) < 0.02) > 0.9


@pytest.mark.parametrize('baseline', [
    np.linspace(0.0, 20.0, 2048), 9.0 * np.exp(-np.arange(2048) / 300.0), 3.0 * np.sin(np.arange(2048) / 300.0)])
def test_a_baseline_that_drifts_is_told_first_and_taken_out_by_the_band(baseline):
    assert not any(drifts(row) for row in SAMPLES)
    samples = SAMPLES + baseline
    answer = mapped(samples[:8]).solve()
    [told] = causes(answer.cautions)
    assert (told.code, answer.status) == ('baseline_drift', 'open')
    assert 'front_end.band_low_hz' in told.remedy
    clean, mended = (mapped(rows[:8], **{'front_end.band_low_hz': 3e4}) for rows in (SAMPLES, samples))
    assert 'baseline_drift' not in [each.code for each in cautions_of(samples[:8], **{'front_end.band_low_hz': 3e4})]
    for one, other in zip(clean.soundings, mended.soundings, strict=True):
        assert one.rho == pytest.approx(other.rho, abs=2e-3)
        assert np.abs(one.echo - other.echo).max() < 0.1 * np.abs(one.echo).max()


def test_only_what_no_signal_has_is_an_offset():
    assert not any(has_offset(row) for row in SAMPLES)
    noise = np.random.default_rng(1).normal(size=2048)
    assert not has_offset(noise + 0.4)
    assert has_offset((noise - 0.6).astype(np.float32))


def test_a_few_pings_with_an_offset_are_not_told():
    offsets = Offsets()
    for k in range(30):
        offsets = offsets.taken(SAMPLES[0] + (99.0 if k % 10 == 9 else 0.0), Parameters())
    assert (offsets.pings, offsets.offset_pings, offsets.cautions) == (30, 3, ())
    assert len(offsets.taken(SAMPLES[0] + 99.0, Parameters()).cautions) == 1


@pytest.mark.parametrize('value', [2048.0, -1.5])
def test_samples_that_are_all_the_same_are_no_ping(value):
    parameters = Parameters()
    with pytest.raises(BadPing, match=f'all 2048 samples are {value:g}: is the receiver connected') as bad:
        Listener(parameters, BeamformingMap(parameters.grid).r_m).admission.check(Ping(0, np.full(2048, value), 1e-6))
    assert bad.value.reason == 'bad_samples'
