"""Whether a ping can be used wherever it was taken, and if not, what is wrong with it and in which unit it may be."""

from math import isfinite

import numpy as np

from polymap_ros.acoustics.front_end import band_pass, clipped, dropped_out, in_band
from polymap_ros.acoustics.ping import FAINTEST, LOUDEST, Ping
from polymap_ros.acoustics.pulse import Pulse, same_period
from polymap_ros.acoustics.units import guessed_unit, likely_length
from polymap_ros.errors import BadPing, ParameterError
from polymap_ros.parameters import Parameters

MAX_SAMPLES = 1 << 20
"""A longer ping is refused: more would be spent on one than on a whole recording."""

MAX_STEPS = 1 << 22
"""So is one that lasts for more steps of the fine range axis than this, which would take as much memory."""

MOST_GAIN_DB = 300.0
"""No device undoes more; beyond, the samples of a ping would be no numbers any longer."""

_UNDERSAMPLED, _FASTER = 1.0, '; sample faster: eight samples a cycle are good, four are enough'
"""Cycles of the pulse in a sample period below which the recorder is likelier too slow than the period wrong."""

_FEWEST_PER_CYCLE = 2.0
"""Samples of a cycle of the pulse, below which it is not to be told."""

_MOST_REACH = 30.0
"""Pings are at most so much longer or shorter than the range axis, or else their period is in another unit: less than
1000, by which units differ, allows for."""

_NEAREST, _LEAST_OF_AXIS = 0.001, 0.01
"""Shares of the range axis: a blanking is longer than the first one, and a ping up to the second one tells no wall."""

_LEAST_IN_BAND = 0.01
"""Share of the pulse's energy that the band-pass has to leave: 20 dB less of every echo, and noise is what is heard."""


class Admission:
    """What a ping has to be, for a device and what is listened to.

    Parameters
    ----------
    parameters : Parameters
        Groups `pulse`, `echo` and `front_end`.
    pulse : Pulse
        That of the device.
    pulse_period_s : float
        The sample period that a recorded pulse asks of all pings [s]; 0 where there is none.
    speed_m_s : float
        Group speed [m/s].
    end_m : float
        End of the range axis [m].
    step_m : float
        Step of the fine range axis [m].
    """

    def __init__(
        self, parameters: Parameters, pulse: Pulse, pulse_period_s: float, speed_m_s: float, end_m: float, step_m: float
    ) -> None:
        self._parameters, self._pulse, self._pulse_period_s = parameters, pulse, pulse_period_s
        self._speed_m_s, self._end_m, self._step_m = speed_m_s, end_m, step_m

    def check(self, ping: Ping) -> None:
        """Raise `BadPing` with the reason if a ping cannot be used wherever it was taken.

        ``bad_shape``: no row of samples with a period and a start in time, or a period too coarse for the pulse;
        ``bad_samples``: samples that are not finite, all zero, or beyond `FAINTEST` and `LOUDEST`;
        ``too_long``: beyond `MAX_SAMPLES` or `MAX_STEPS`;
        ``too_short``: over before an echo from beyond the blanking would be.
        """
        samples, period_s, t0_s = ping.samples, ping.period_s, ping.t0_s
        if samples.ndim != 1:
            raise BadPing('bad_shape', f'the samples are an array of shape {samples.shape}; allowed: one row, (n,)')
        if samples.dtype.kind != 'f':
            raise BadPing('bad_shape', f'the samples are of type {samples.dtype}; allowed: real numbers, signed '
                                       '(echo.kind: rf) or magnitudes (envelope)')
        if not (isfinite(period_s) and period_s > 0.0 and isfinite(t0_s)):
            raise BadPing('bad_shape', f'sample period {period_s:g} s from {t0_s:g} s; allowed: finite, period above 0')
        frequency_hz = self._parameters.pulse.frequency_hz
        if self._parameters.echo.kind == 'rf' and not period_s * frequency_hz < 0.5:
            hint = self._likely_unit(ping) if period_s * frequency_hz >= _UNDERSAMPLED else _FASTER
            raise BadPing('bad_shape', f'a sample period of {period_s:g} s cannot hold a pulse of {frequency_hz:g} Hz'
                                       f'{hint}')
        own_s = self._pulse_period_s
        if own_s and not same_period(period_s, own_s):
            raise BadPing('bad_shape', f'pulse.path is sampled at {1.0 / own_s:g} Hz, the echoes at {1.0 / period_s:g} '
                                       "Hz; resample the pulse to the echoes' rate")
        reach_m = 0.5 * self._speed_m_s * (abs(t0_s) + samples.size * period_s)
        most_m = MAX_STEPS * self._step_m
        if samples.size > MAX_SAMPLES or reach_m > most_m:
            raise BadPing('too_long', f'{samples.size} samples of {period_s:g} s, {reach_m:.3g} m of range; allowed: '
                                      f'{MAX_SAMPLES} samples, {most_m:.3g} m{self._likely_unit_of_reach(ping)}')
        gain_db = abs(self._parameters.front_end.gain_db_s) * (abs(t0_s) + samples.size * period_s)
        if gain_db > MOST_GAIN_DB:
            raise BadPing('too_long', f'front_end.gain_db_s comes to {gain_db:.3g} dB over a ping of {samples.size} '
                                      f'samples; allowed: up to {MOST_GAIN_DB:g} dB')
        needed_s = self.blanked_s(ping) + self._pulse.duration_s
        end_s = t0_s + samples.size * period_s
        self._check_limits(ping, 0.5 * self._speed_m_s * (end_s - self._pulse.duration_s))
        if end_s < needed_s:
            raise BadPing('too_short', f'{samples.size} samples end {end_s:g} s after emission; an echo from beyond '
                                       f'the blanking is over after {needed_s:g} s{self._likely_unit(ping)}')
        if not FAINTEST <= (peak := float(np.max(np.abs(samples)))) <= LOUDEST:
            if not isfinite(peak):
                bad = np.sum(~np.isfinite(samples))
                raise BadPing('bad_samples', f'{bad} of {samples.size} samples are not finite')
            if peak == 0.0:
                raise BadPing('bad_samples', f'all {samples.size} samples are zero')
            raise BadPing('bad_samples', f'the largest sample is {peak:g}; allowed: {FAINTEST:g} to {LOUDEST:g}')
        if samples.min() == samples.max():
            raise BadPing('bad_samples', f'all {samples.size} samples are {samples[0]:g}: is the receiver connected?')
        self._check_converter(ping)

    def _check_limits(self, ping: Ping, reach_m: float) -> None:
        """Raise `BadPing` if the message's own limits, in another unit, leave nothing of a ping that reaches so far."""
        end_m = self._end_m
        last_m, allowed_m = min(end_m, reach_m), self._parameters.echo.blanking_m
        unit = likely_length(ping.range_min_m, _NEAREST * end_m, last_m)
        if allowed_m < last_m < ping.range_min_m and unit:
            raise BadPing('too_short', f'range_min of the message is {ping.range_min_m:g} m, echoes can be heard up to '
                                       f'{last_m:.3g} m{unit}')
        if 0.0 < ping.range_max_m <= max(_LEAST_OF_AXIS * end_m, allowed_m):
            unit = likely_length(ping.range_max_m, end_m / _MOST_REACH, end_m * _MOST_REACH)
            raise BadPing('bad_shape', f'range_max of the message is {ping.range_max_m:g} m, which leaves nothing to '
                                       f'hear{unit}')

    def _likely_unit_of_reach(self, ping: Ping) -> str:
        if abs(ping.t0_s) > _MOST_REACH * ping.samples.size * ping.period_s:
            return f'; the first sample is {ping.t0_s:g} s after emission: echo.t0_s is in seconds'
        return self._likely_unit(ping)

    def _likely_unit(self, ping: Ping) -> str:
        """Name the unit that the sample period of a ping that cannot be right may be in."""
        longest_s = 1.0 / (_FEWEST_PER_CYCLE * self._parameters.pulse.frequency_hz)
        useful_s = 2.0 * self._end_m / self._speed_m_s / max(ping.samples.size, 1)
        return guessed_unit(ping.period_s, useful_s, min(longest_s, _MOST_REACH * useful_s), useful_s / _MOST_REACH,
                            ping.samples.size)

    def _check_converter(self, ping: Ping) -> None:
        """Raise `BadPing` if more samples beyond the blanking are clipped or dropped out than `front_end.max_bad`."""
        allowed = self._parameters.front_end.max_bad
        if allowed == 1.0:
            return
        first = max(int(np.ceil((self.blanked_s(ping) - ping.t0_s) / ping.period_s)), 0)
        for what, bad in (('clipped', clipped(ping.samples)), ('dropped out', dropped_out(ping.samples))):
            if (share := float(np.mean(bad[first:]))) > allowed:
                raise BadPing('bad_samples', f'{share:.1%} of the samples beyond the blanking are {what}; allowed: '
                                             f'{allowed:.1%} (front_end.max_bad)')

    def blanking_m(self, ping: Ping) -> float:
        """Return up to which range a ping is not listened to [m]."""
        return max(self._parameters.echo.blanking_m, ping.range_min_m)

    def blanked_s(self, ping: Ping) -> float:
        """Return when an echo from the end of the blanking begins, after emission [s]."""
        return 2.0 * self.blanking_m(ping) / self._speed_m_s


def check_length(pulse: Pulse, period_s: float, listened_s: float) -> None:
    """Raise `ParameterError` if a recorded pulse is longer than pings are listened to [s].

    Where its sample period is not known yet (0), only if that can be no pulse whatever the period is.
    """
    most_s = listened_s if period_s else _MOST_REACH * listened_s
    if pulse.duration_s > most_s:
        lasts = f'it lasts {pulse.duration_s:.3g} s' if period_s else f'{pulse!r}'
        raise ParameterError('pulse.path', f'{lasts}, and pings are listened to for {listened_s:.3g} s '
                             '(grid.range_max_m); cut it to the pulse alone')


def check_band(parameters: Parameters, pulse: Pulse) -> None:
    """Raise `ParameterError` if the band-pass takes the pulse out."""
    low_hz, high_hz = parameters.front_end.band_low_hz, parameters.front_end.band_high_hz
    if not low_hz and not high_hz:
        return
    period_s = min(0.125 / parameters.pulse.frequency_hz, pulse.duration_s / 16.0)
    samples = pulse.samples(period_s)
    left = in_band(samples, band_pass(len(samples), period_s, low_hz, high_hz))
    share = float(np.sum(left**2) / np.sum(samples**2))
    if share < _LEAST_IN_BAND:
        name = 'front_end.band_low_hz' if low_hz > parameters.pulse.frequency_hz else 'front_end.band_high_hz'
        raise ParameterError(name, f"{parameters[name]!r} takes out the pulse: {share:.1%} of its energy is in the "
                                   f'band; allowed: at least {_LEAST_IN_BAND:.0%}')
