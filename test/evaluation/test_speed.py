"""The speed experiment: what it compares with is exact, and it writes its rows; never how fast anything is."""

import csv

import numpy as np
import pytest

from polymap_ros.acoustics.matched_filter import MatchedFilter
from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.commands.evaluate import main
from polymap_ros.evaluation.paired import paired
from polymap_ros.evaluation.speed_experiment import N_SAMPLES, PERIOD_S, exact_eq_3
from polymap_ros.parameters import Parameters


def rows(path):
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


class Clock:
    """Stands still but for what the functions measured add to it."""

    now_s = 0.0

    def __call__(self):
        return self.now_s

    def work(self, *durations_s):
        left = list(durations_s)

        def function():
            self.now_s += left.pop(0)
        return function


def test_the_ratio_is_the_median_within_repetitions():
    clock = Clock()
    result = paired(('slow', clock.work(2.0, 9.0, 4.0)), ('quick', clock.work(1.0, 3.0, 1.0)), 3, '', clock=clock)
    assert (result.seconds, result.reference_seconds, result.ratio) == (4.0, 1.0, 3.0)  # of 2, 3 and 4
    assert (result.ratio_low, result.ratio_high) == (2.5, 3.5)
    assert paired(('slow', clock.work(2.0)), ('a second', 1.0), 1, '', clock=clock).ratio == 2.0


def test_short_functions_are_called_until_they_can_be_measured():
    clock = Clock()
    first_s = 9.0  # with what is loaded on first use
    result = paired(('short', clock.work(first_s, *[1.0] * 100)), ('short', clock.work(first_s, *[0.5] * 100)), 2, '',
                    6.0, clock)
    assert (result.seconds, result.reference_seconds) == (1.0, 0.5)
    assert clock.now_s == 2 * first_s + 1 + 2 + 4 + 8 + 0.5 + 1 + 2 + 4 + 8 + 2 * (8 + 8)


def test_what_eq_3_is_compared_with_is_the_correlation_with_the_expected_echo():
    """By Parseval's theorem over the whole spectrum; a wall's own echo correlates with 1 at its range."""
    parameters = Parameters()
    medium, pulse = make_medium(parameters.medium), make_pulse(parameters.pulse)
    ranges_m = np.array([0.5, 0.8, 1.0])
    omega = 2.0 * np.pi * np.fft.rfftfreq(N_SAMPLES, PERIOD_S)[1:]
    echo = pulse.spectrum(omega) * medium.excitability(omega) * np.exp(-2j * medium.wavenumber(omega) * 0.8)
    samples = np.fft.irfft(np.concatenate(([0.0], echo)), N_SAMPLES)
    values = exact_eq_3(samples, medium, pulse, ranges_m)
    assert values[1] == pytest.approx(1.0, abs=1e-3)
    assert np.abs(values[[0, 2]]).max() < 0.1
    axis_m = 0.005 * np.arange(240)
    found = MatchedFilter(medium, pulse, axis_m, N_SAMPLES, PERIOD_S)(samples)
    np.testing.assert_allclose(found[[100, 160, 200]], values, rtol=0, atol=1e-3)


@pytest.fixture(scope='module')
def measured(tmp_path_factory):
    folder = tmp_path_factory.mktemp('speed')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('polymap_ros.commands.speed.PING_HZ', 1.0)  # 30 pings to be simulated
        status = main(['speed', '--repetitions', '1', '--minutes', '0.5', '--output', str(folder / 'out')])
    assert status == 0
    return folder / 'out'


def test_every_operation_has_its_row(measured):
    found = rows(measured / 'results.csv')
    names = [row['operation'] for row in found]
    starts = ['eq. (3)', 'eq. (4)', 'eq. (5)', 'evidence solve', 'evidence solve, warm',
              'polymap_replay of 0.5 minutes',
              *(f'polymap_{name} --help' for name in ('node', 'replay', 'play', 'simulate', 'evaluate'))]
    assert [name.startswith(start) for name, start in zip(names, starts, strict=True)] == [True] * len(starts)
    for row in found:
        assert float(row['ratio']) == pytest.approx(float(row['seconds']) / float(row['reference_seconds']), rel=1e-6)
    assert float(found[0]['note'].split()[1]) < 2e-3  # the error of eq. (3), which is no matter of time
    table = (measured / 'table.md').read_text()
    assert all(f'| {name} |' in table for name in names)


def test_growth_over_what_may_grow(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('polymap_ros.evaluation.growth.SAMPLES', (512, 1024))
    monkeypatch.setattr('polymap_ros.evaluation.growth.STEPS_M', (0.02,))
    monkeypatch.setattr('polymap_ros.evaluation.growth.LINES', (5,))
    assert main(['speed', '--growth', '250', '--output', str(tmp_path)]) == 0
    assert [(row['over'], row['size']) for row in rows(tmp_path / 'results.csv')] == [
        ('pings', '100'), ('pings', '100'), ('pings', '250'), ('pings', '250'), ('samples', '512'), ('samples', '1024'),
        ('cells of the grid', '13500'), ('lines K', '5')]
    assert all(float(row['seconds']) > 0.0 and float(row['memory_mb']) > 0.0 for row in rows(tmp_path / 'results.csv'))


def test_other_options_are_refused(tmp_path, capsys):
    assert main(['speed', '--seeds', '0:1', '--output', str(tmp_path)]) == 2
    assert main(['paper', '--growth', '--output', str(tmp_path)]) == 2
    assert main(['speed', '--minutes', '-1', '--repetitions', '1', '--output', str(tmp_path)]) == 2
    assert '--minutes -1; allowed: above 0' in capsys.readouterr().err
