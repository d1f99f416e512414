"""A real small robot that drives at a glass wall and plays tones: magnitudes only, made into range profiles.

The microphones hear the buzzer and its echo together: their loudness rises and falls with the frequency, the faster the
longer the echo's way is. The Fourier transform of the loudness over the frequency is an envelope over range, about 7 cm
wide. Sources: F. Duembgen et al., IEEE Robot. Autom. Lett. 7, 8487 (2022), and its data set.
"""

import csv
import io
import json
import os
import re
import tarfile
from pathlib import Path

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, odometry_message
from polymap_ros.recordings.writing import RecordingWriter, make
from polymap_ros.results.arrays import read_state

DATA = Path(os.environ.get('POLYMAP_DATA') or Path(__file__).parents[2].parent / 'shared' / 'data')
ARCHIVE = DATA / 'epuck_wall' / 'csv_files.tar.gz'
SPEED_M_S = 343.0
LOWEST_HZ = 2700.0
"""Below, the buzzer is too quiet."""

NEAREST_M, FIRST_M, STEP_M = 0.15, 0.05, 0.002
CENTRE_S = 0.5 * 3.0 / 4000.0

# The wall is known to be ahead: on one straight leg its direction cannot be told from the scale of the ranges.
PARAMETERS = f'''
/**:
  ros__parameters:
    medium: {{model: constant, speed_m_s: {SPEED_M_S}}}
    pulse: {{frequency_hz: 4000.0, cycles: 3.0}}
    echo: {{kind: envelope, blanking_m: 0.08, t0_s: {CENTRE_S + 2.0 * FIRST_M / SPEED_M_S}}}
    grid: {{range_max_m: 0.8, range_step_m: 0.002, angle_step_deg: 1.0, angle_min_deg: -5.0, angle_max_deg: 5.0}}
'''

pytestmark = pytest.mark.skipif(not ARCHIVE.exists(), reason=f'{ARCHIVE} is not there')


def numbers(text):
    return np.array(re.sub(r'[\[\]]', '', text).split(), dtype=float)


def loudness(text):
    """By frequency: magnitude at the four microphones in the loudest bin of each tone."""
    found = {}
    for row in csv.DictReader(text):
        real, imaginary = (numbers(row[f'signals_{part}_vect']).reshape(4, -1) for part in ('real', 'imag'))
        magnitude = np.hypot(real, imaginary)
        loudest = np.sum(magnitude**2, axis=0).argmax()
        found[numbers(row['frequencies'])[loudest]] = magnitude[:, loudest]
    return found


@pytest.fixture(scope='module')
def profiles():
    """Distances (n,) [m], the farthest first, and envelopes (n, n_ranges) from `FIRST_M` in steps of `STEP_M`."""
    csv.field_size_limit(10**7)
    heard = {}
    with tarfile.open(ARCHIVE) as archive:
        for member in archive.getmembers():
            if member.name.endswith('.csv'):
                distance_m = float(member.name.rpartition('_')[2].removesuffix('.csv')) / 100.0
                heard[distance_m] = loudness(io.TextIOWrapper(archive.extractfile(member), 'utf-8'))
    distances = np.array(sorted(heard, reverse=True))
    tones = {tone for each in heard.values() for tone in each}
    tones = np.array(sorted(tone for tone in tones if tone >= LOWEST_HZ
                            and sum(tone in each for each in heard.values()) > 0.8 * len(heard)))
    silent = np.full(4, np.nan)
    levels = np.array([[heard[distance].get(tone, silent) for tone in tones] for distance in distances])
    change = np.nan_to_num(levels / np.nanmedian(levels, axis=0) - 1.0)  # what the wall does to the loudness
    change -= change.mean(axis=1, keepdims=True)
    change *= np.hanning(len(tones) + 2)[1:-1, None]
    ranges = np.arange(FIRST_M, 0.8, STEP_M)
    turns = np.exp(2j * np.pi * np.outer(tones, 2.0 * ranges / SPEED_M_S))
    return distances, np.abs(np.einsum('dfm,fr->dmr', change, turns)).mean(axis=1)


def mapped(call, folder, distances, envelopes):
    """The robot drives straight ahead from the farthest place."""
    with RecordingWriter(folder / 'epuck') as writer:
        for k, (distance, envelope) in enumerate(zip(distances, envelopes, strict=True)):
            emission_ns = 10**9 + k * 500_000_000
            pose = Pose(float(distances[0] - distance), 0.0)
            writer.write('/odom', odometry_message(make, emission_ns, 'odom', pose), emission_ns)
            first_ns = emission_ns + round((CENTRE_S + 2.0 * FIRST_M / SPEED_M_S) * 1e9)
            ping = Ping(first_ns, envelope.astype(np.float32), 2.0 * STEP_M / SPEED_M_S, frame_id='buzzer')
            writer.write('/echo', echo_message(make, ping), emission_ns + 10_000_000)
    (folder / 'epuck.yaml').write_text(PARAMETERS)
    done = call('replay', folder / 'epuck', '--params-file', 'epuck.yaml', '--output', 'out', '--save-map',
                '-p', 'solver.method:=paper')
    assert done.status == 1, done.err
    with np.load(folder / 'out' / 'beam_map.npz', allow_pickle=False) as arrays:
        values, r_m = arrays['map'], arrays['r_m']
    column = np.unravel_index(values.argmax(), values.shape)[1]
    rho = read_state(folder / 'out' / 'state.npz')['soundings.places'][:, 2]
    return json.loads((folder / 'out' / 'polygon.json').read_text()), r_m[column], rho


def test_the_wall_is_where_it_is_from_below_45_cm(call, profiles, tmp_path):
    distances, envelopes = profiles
    near = (distances < 0.45) & (distances > NEAREST_M)  # nearer, the echo is within the direct sound
    found, r_m, rho = mapped(call, tmp_path, distances[near], envelopes[near])
    assert found['pings'] == {'received': int(near.sum()), 'used': int(near.sum()), 'dropped': {}}
    assert r_m == pytest.approx(distances[near][0], abs=0.02)
    # A profile is 7 cm wide and has few independent cells: a range of its own stands out of some only, and is right.
    errors = np.abs(rho - distances[near])
    assert np.isfinite(errors).sum() >= 7
    assert np.nanmax(errors) < 0.02
    peaks = FIRST_M + STEP_M * envelopes[near].argmax(axis=1)
    assert np.mean(np.abs(peaks - distances[near]) < 0.02) >= 0.85


def test_what_cannot_be_had_is_said(call, profiles, tmp_path):
    distances, envelopes = profiles
    found, *_ = mapped(call, tmp_path, distances[distances < 0.45], envelopes[distances < 0.45])
    # One straight drive at one wall: no polygon, and no telling the sides apart.
    assert (found['status'] in ('open', 'ambiguous'), found['vertices']) == (True, [])
    assert 'straight_path' in [warning['code'] for warning in found['warnings']]
    # Beyond half a metre the wall changes the loudness less than everything else does.
    far = distances > 0.51
    peaks = FIRST_M + STEP_M * envelopes[far].argmax(axis=1)
    assert np.mean(np.abs(peaks - distances[far]) < 0.05) < 0.5
