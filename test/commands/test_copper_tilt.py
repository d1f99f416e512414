"""Real ultrasound: a pulse-echo line scan of a tilted copper plane in water becomes a recording and is replayed."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.signal

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, odometry_message
from polymap_ros.recordings.writing import RecordingWriter, make

DATA = Path(os.environ.get('POLYMAP_DATA') or Path(__file__).parents[2].parent / 'shared' / 'data')
SCAN = DATA / 'copper_tilt' / 'CopperBlock_2degtTilt.mat'
SPEED_M_S, FREQUENCY_HZ = 1480.0, 1.9e6
CYCLES = 7.0
"""A Hann burst as long as the recorded one, 1.7 us at half of its maximum."""
BURST_CENTRE_S = 0.5 * CYCLES / FREQUENCY_HZ
TILT_DEG = 2.218
"""Line fit of the envelope's maxima, computed independently of the project."""

PARAMETERS = f'''
/**:
  ros__parameters:
    medium: {{model: constant, speed_m_s: {SPEED_M_S}}}
    pulse: {{frequency_hz: {FREQUENCY_HZ}, cycles: {CYCLES}}}
    echo: {{t0_s: 5.5e-5, blanking_m: 0.03}}
    grid: {{range_max_m: 0.09, range_step_m: 5.0e-5, angle_step_deg: 0.02, angle_min_deg: 80.0, angle_max_deg: 100.0}}
'''

pytestmark = pytest.mark.skipif(not SCAN.exists(), reason=f'{SCAN} is not there')


@pytest.fixture(scope='module')
def scan():
    """Samples (n_positions, n_samples), sample period [s], positions [m]."""
    content = scipy.io.loadmat(SCAN)
    samples = content['ptx'].T.astype(np.float32)
    assert content['tDelay'].item() == pytest.approx(5.5e-5)
    return samples, 1.0 / content['fs'].item(), np.arange(len(samples)) * content['xStep'].item()


def envelopes(samples):
    """Magnitudes, as a device that records no more gives them."""
    return np.abs(scipy.signal.hilbert(samples - samples.mean(axis=1, keepdims=True), axis=1)).astype(np.float32)


@pytest.fixture(scope='module', params=['rf', 'envelope'])
def kind(request):
    return request.param


@pytest.fixture(scope='module')
def recording(scan, kind, tmp_path_factory):
    """The sensor slides along x, heading along the line; a ping every 50 ms, odometry at 20 Hz in between."""
    samples, period_s, x_m = scan
    samples = samples if kind == 'rf' else envelopes(samples)
    path = tmp_path_factory.mktemp('copper') / 'copper'
    with RecordingWriter(path) as writer:
        for k, (trace, x) in enumerate(zip(samples, x_m, strict=True)):
            emission_ns = 10**9 + k * 50_000_000
            writer.write('/odom', odometry_message(make, emission_ns, 'odom', Pose(float(x), 0.0)), emission_ns)
            ping = Ping(emission_ns + 55_000, trace, period_s, frame_id='probe')
            writer.write('/echo', echo_message(make, ping), emission_ns + 200_000)
    return path


# The converter clipped the burst, so that its magnitudes have a flat top with ripples: they are smoothed to the length
# of the burst. The matched filter does so by itself.
SMOOTHED = {'rf': (), 'envelope': ('-p', 'front_end.band_high_hz:=2.0e5')}


def line_fit(scan):
    """Tilt [deg] and distance [m] of the wall at x = 0 from a straight line through the envelope's maxima."""
    samples, period_s, x_m = scan
    times_s = 5.5e-5 + period_s * envelopes(samples).argmax(axis=1) - BURST_CENTRE_S
    slope, offset_m = np.polyfit(x_m, 0.5 * SPEED_M_S * times_s, 1)
    return np.rad2deg(np.arcsin(slope)), offset_m


@pytest.mark.parametrize('method', ['evidence', 'paper'])
def test_the_map_peaks_at_the_copper_plane(call, scan, kind, recording, tmp_path, method):
    (tmp_path / 'copper.yaml').write_text(PARAMETERS)
    done = call('replay', recording, '--params-file', 'copper.yaml', '--output', 'out', '--save-map', '--plot',
                '-p', f'solver.method:={method}', '-p', f'echo.kind:={kind}', *SMOOTHED[kind])
    assert done.status == 1, done.err
    assert 'mirror images' in done.complaint

    found = json.loads((tmp_path / 'out' / 'polygon.json').read_text())
    assert (found['vertices'], found['edges']) == ([], [])
    assert found['status'] in ('open', 'ambiguous')
    assert 'straight_path' in [warning['code'] for warning in found['warnings']]
    assert found['pings'] == {'received': 301, 'used': 301, 'dropped': {}}
    assert not (tmp_path / 'out' / 'map.pgm').exists()

    with np.load(tmp_path / 'out' / 'beam_map.npz', allow_pickle=False) as arrays:
        values, r_m, theta_rad = arrays['map'], arrays['r_m'], arrays['theta_rad']
        np.testing.assert_allclose(arrays['start_pose'], [0.0, 0.0, 0.0], atol=1e-12)
    row, column = np.unravel_index(values.argmax(), values.shape)
    tilt_deg, offset_m = line_fit(scan)
    assert tilt_deg == pytest.approx(TILT_DEG, abs=0.02)
    # The wall recedes along the scan, so that its normal leans back: theta = 90 deg + tilt.
    assert np.rad2deg(theta_rad[row]) - 90.0 == pytest.approx(tilt_deg, abs=0.05)
    assert r_m[column] == pytest.approx(offset_m, abs=2e-4)
