"""A recorded pulse is found beside the parameter file, and a wrong one is refused by name."""

import numpy as np
import pytest
import scipy.io.wavfile

from polymap_ros.errors import ParameterError, SceneError
from polymap_ros.parameter_file import load_parameters
from polymap_ros.parameters import Parameters
from polymap_ros.pulse_file import read_pulse
from polymap_ros.simulation.scene_file import load_scene

SAMPLES = np.sin(np.arange(40)) * np.hanning(40)


def parameters(folder, name):
    (folder / 'p.yaml').write_text(
        f'polymap_node: {{ros__parameters: {{pulse: {{kind: file, path: "{name}"}}}}}}')
    return load_parameters(folder / 'p.yaml')


def contents(folder, name):
    pulse = read_pulse(parameters(folder, name))
    return pulse.recorded, pulse.period_s


def test_the_other_kinds_need_no_file():
    assert read_pulse(Parameters()) is None
    with pytest.raises(ParameterError, match=r"pulse\.path: '' names no file"):
        read_pulse(Parameters.of(pulse={'kind': 'file'}))


def test_an_offset_is_told_and_a_pulse_of_one_sign_has_none(tmp_path):
    np.save(tmp_path / 'pulse.npy', 2048 + 200 * SAMPLES)
    with pytest.raises(ParameterError, match=r'lie about 2048 with a deviation of .*; subtract that offset'):
        read_pulse(parameters(tmp_path, 'pulse.npy'))
    np.save(tmp_path / 'pulse.npy', np.hanning(40))
    assert contents(tmp_path, 'pulse.npy')[0].max() > 0.9


@pytest.mark.parametrize('dtype', [np.float32, np.float64])
def test_npy_relative_to_the_parameter_file(tmp_path, monkeypatch, dtype):
    (tmp_path / 'sub').mkdir()
    np.save(tmp_path / 'sub' / 'pulse.npy', SAMPLES.astype(dtype))
    monkeypatch.chdir(tmp_path / 'sub')
    found, period_s = contents(tmp_path, 'sub/pulse.npy')
    assert period_s == 0.0
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, SAMPLES, atol=1e-7)


@pytest.mark.parametrize(('scale', 'dtype', 'tolerance'), [
    (1.0, np.float32, 1e-7), (32768.0, np.int16, 3.1e-5), (2147483648.0, np.int32, 1e-9)])
def test_wav_is_scaled_to_one(tmp_path, scale, dtype, tolerance):
    stereo = np.column_stack((SAMPLES, np.zeros(40))) * 0.9 * scale
    scipy.io.wavfile.write(tmp_path / 'pulse.wav', 1_000_000, stereo.astype(dtype))
    found, period_s = contents(tmp_path, 'pulse.wav')
    assert period_s == 1e-6
    np.testing.assert_allclose(found, 0.9 * SAMPLES, atol=tolerance)


def test_wav_of_eight_bits_is_centred(tmp_path):
    scipy.io.wavfile.write(tmp_path / 'pulse.wav', 250_000, np.array([0, 128, 192], np.uint8))
    np.testing.assert_array_equal(contents(tmp_path, 'pulse.wav')[0], [-1.0, 0.0, 0.5])


@pytest.mark.parametrize(('name', 'content', 'reason'), [
    ('none.npy', None, 'No such file'),
    ('pulse.txt', b'1 2 3', 'neither .npy nor .wav'),
    ('pulse.npy', b'', 'cannot be read'),
    ('pulse.npy', b'\x93NUMPY\x01\x00', 'cannot be read'),
    ('pulse.wav', b'RIFF', 'cannot be read'),
    ('pulse.wav', bytes(100), 'cannot be read'),
])
def test_a_file_that_is_no_pulse(tmp_path, name, content, reason):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ParameterError, match=f'pulse.path: .*{name}.*{reason}'):
        read_pulse(parameters(tmp_path, name))


@pytest.mark.parametrize('samples', [
    np.zeros(40), np.full(40, 5.0), SAMPLES + 5.0, 2048 + (200 * SAMPLES).astype(int),
    np.array([1.0]), np.array([1.0, np.nan]), np.ones((3, 4)), np.array(['a', 'b']),
    np.array([{}, {}], dtype=object), np.array([1j, 2])])
def test_samples_that_are_no_pulse(tmp_path, samples):
    np.save(tmp_path / 'pulse.npy', samples, allow_pickle=True)
    with pytest.raises(ParameterError, match=r'pulse.path: .*pulse\.npy: '):
        read_pulse(parameters(tmp_path, 'pulse.npy'))


@pytest.mark.parametrize(('rate_hz', 'values', 'says'), [
    (44_100, {}, 'sampled at 44100 Hz, which cannot hold pulse.frequency_hz (100000 Hz); allowed: '),
    (750, {}, 'sampled at 750 Hz, which cannot hold'),
    (500_000, {'echo.sample_period_s': 1e-6}, 'sampled at 500000 Hz, the echoes at 1e+06 Hz (echo.sample_period_s); '),
])
def test_a_sample_rate_that_the_echoes_cannot_have(tmp_path, rate_hz, values, says):
    scipy.io.wavfile.write(tmp_path / 'pulse.wav', rate_hz, SAMPLES.astype(np.float32))
    with pytest.raises(ParameterError, match=r'pulse\.path: .*pulse\.wav: ') as refused:
        read_pulse(parameters(tmp_path, 'pulse.wav').replaced(values))
    assert says in str(refused.value)


def test_a_scene_has_the_rate_of_its_pulse(tmp_path):
    scipy.io.wavfile.write(tmp_path / 'pulse.wav', 1_000_000, SAMPLES.astype(np.float32))
    scene = 'vertices: [[0, 0], [1, 0], [0, 1]]\nposes: [[0.2, 0.2, 0]]\npulse: {kind: file, path: pulse.wav}\n'
    (tmp_path / 'a.yaml').write_text(scene)
    np.testing.assert_allclose(load_scene(str(tmp_path / 'a.yaml')).recorded_pulse, SAMPLES, atol=1e-7)
    (tmp_path / 'b.yaml').write_text(f'{scene}sample_rate_hz: 800000\n')
    with pytest.raises(SceneError, match=r'sampled at 1e\+06 Hz, the scene at 800000 Hz \(sample_rate_hz\)'):
        load_scene(str(tmp_path / 'b.yaml'))
