"""signals.png is drawn from what the mapper made of the pings, whatever they are like."""

import io

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.parameters import Parameters
from polymap_ros.results.signal_picture import signals_png
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import pings

matplotlib = pytest.importorskip('matplotlib')

STEPS = {'front_end.common_pings': 32, 'front_end.remove_dc': True, 'front_end.mute_blanking': True}


def drawn(mapper, heard):
    from matplotlib.image import imread

    return imread(io.BytesIO(signals_png(mapper, heard)))


@pytest.fixture(scope='module')
def scene():
    return load_scene('pentagon')


def test_every_step_that_is_on_is_shown_and_ends_in_what_is_heard(scene):
    mapper, heard = filled_mapper(scene, Parameters().replaced(STEPS)), pings(scene)
    signals = mapper.signals(heard[30])
    assert [name for name, _ in signals.steps] == [
        'as received', 'without DC, with gain over time', 'in the band, blanking muted']  # nothing is in common here
    np.testing.assert_array_equal(signals.steps[0][1], heard[30].samples)
    assert abs(signals.steps[1][1].mean()) < 1e-6
    kept = mapper.soundings[30]
    np.testing.assert_allclose(signals.envelope, kept.envelope / kept.noise, rtol=1e-4, atol=1e-4)
    assert signals.rho == pytest.approx(kept.rho)
    # The middle of the echo of a wall at 1 m comes two paths and half a pulse after emission.
    assert np.interp(1.0, signals.range_m, signals.time_s) == pytest.approx(2.0 / 2973.0 + 1e-5, abs=1e-6)
    picture = drawn(mapper, heard)
    assert picture.shape[0] > 800
    assert 0.02 < np.mean(picture[..., :3].mean(axis=2) < 0.9) < 0.9


def test_pings_that_cannot_be_used_are_left_out_and_none_is_no_error(scene):
    mapper, heard = filled_mapper(scene, Parameters()), pings(scene)
    silent = Ping(0, np.zeros(2048, np.float32), 1e-6)
    assert drawn(mapper, [silent, *heard[:3], silent]).shape[0] > 500
    assert drawn(mapper, [silent]).shape[0] > 500
