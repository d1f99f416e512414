"""Time zero as the direct wave tells it."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.acoustics.common_part import common_part
from polymap_ros.acoustics.direct_wave import direct_wave_t0
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.parameters import PulseParameters, SensorParameters
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import simulate

PULSE = make_pulse(PulseParameters())


@pytest.mark.parametrize('first', [-7, 0, 31])
def test_a_pulse_in_the_samples_is_where_emission_was(first):
    common = np.zeros(500)
    wave = PULSE.samples(1e-6)
    common[max(first, 0):first + len(wave)] = wave[max(-first, 0):]
    common[first + 60:first + 60 + len(wave)] += 1.5 * wave  # what rings after it may be stronger
    assert direct_wave_t0(common, 1e-6, PULSE) == pytest.approx(-first * 1e-6, abs=2e-6 if first < 0 else 2e-7)
    assert direct_wave_t0(common, 1e-6, PULSE, 5e-6) == pytest.approx(5e-6 - first * 1e-6, abs=2e-6)


def test_nothing_in_common_tells_nothing():
    assert direct_wave_t0(np.zeros(500), 1e-6, PULSE) is None


@pytest.mark.parametrize('baseline_m', [0.0, 0.05])
def test_pings_with_ringing_tell_it_to_a_few_microseconds(baseline_m):
    scene = dataclasses.replace(random_scene(3, 4), t0_s=-2.5e-5, faults=Faults(direct_wave=10.0),
                                sensor=SensorParameters(baseline_x_m=baseline_m))
    common = common_part(simulate(scene), 20)
    assert direct_wave_t0(common, 1e-6, PULSE, baseline_m / 2973.0) == pytest.approx(-2.5e-5, abs=4e-6)
