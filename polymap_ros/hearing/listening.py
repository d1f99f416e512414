"""What a ping tells at its own place: eq. (3), its envelope and the closest range, or why it cannot be used."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from math import isfinite
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.acoustics.front_end import FrontEnd
from polymap_ros.acoustics.interference import Freed, Interference
from polymap_ros.acoustics.matched_filter import EchoFilter, EnvelopeFilter, MatchedFilter, sampling_step
from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.acoustics.noise import NoiseGauge, noise_from_envelope
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import RecordedPulse, make_pulse
from polymap_ros.acoustics.ranging import closest_range, confidence, first_echo
from polymap_ros.errors import BadPing, ParameterError
from polymap_ros.hearing.admission import Admission, check_band, check_length
from polymap_ros.hearing.pulse_shape import PulseShape
from polymap_ros.hearing.signals import Signals
from polymap_ros.map_parameters import MOST_RANGES
from polymap_ros.parameters import Parameters

_FILTERS = 8
"""Filters kept: pings of so many different lengths, periods and starts may alternate."""

_NO_ECHO = np.empty(0, np.complex64)

Later: TypeAlias = Callable[[Callable[[], None]], None]
"""Does a job that takes long: at once, or in another thread."""


def at_once(job: Callable[[], None]) -> None:
    """Do a job before going on."""
    job()


class Heard(NamedTuple):
    """Eq. (3) on the fine axis, its magnitude on the range axis, the closest range [m] and so on; see `Sounding`."""

    echo: NDArray[np.complex64]
    envelope: NDArray[np.float32]
    rho: float
    noise: float
    confidence: float
    heard_m: float


class Listener:
    """Applies eq. (3) to pings of any length, period and start.

    Parameters
    ----------
    parameters : Parameters
        Groups `medium`, `pulse`, `echo`, `front_end` and `free_area`.
    ranges_m : ndarray, shape (n_ranges,)
        Range axis from 0 [m].
    recorded_pulse : RecordedPulse or ndarray, shape (n,), optional
        That of ``pulse.kind: file``.
    later : callable, optional
        Builds the filter that the first ping of a length needs; default: at once.
    period_s : float, optional
        Sample period of a recorded pulse that does not tell its own [s]. Where `echo.sample_period_s` does not either,
        it is that of the pings; see `at`.

    Attributes
    ----------
    admission : Admission
        Says which pings can be used.
    fold : int
        Steps of the echoes' fine axis per step of the range axis: an echo can be interpolated, an envelope looked up.
    n_fine : int
        Steps of the fine axis.
    pulse : Pulse
        A recorded one whose sample period is not known yet has eight samples a cycle.
    recorded_period_s : float
        Sample period of the recorded pulse [s], and so of all pings; 0 where it is not known yet, or none is recorded.
    """

    def __init__(
        self, parameters: Parameters, ranges_m: NDArray[np.float64],
        recorded_pulse: RecordedPulse | ArrayLike | None = None, later: Later = at_once,
        period_s: float = 0.0,
    ) -> None:
        self._later = later
        self._parameters = parameters
        self._ranges_m = ranges_m
        self._step_m = float(ranges_m[1] - ranges_m[0])
        is_recorded = parameters.pulse.kind == 'file'
        own_s = recorded_pulse.period_s if isinstance(recorded_pulse, RecordedPulse) else 0.0
        self.recorded_period_s = (own_s or parameters.echo.sample_period_s or period_s) if is_recorded else 0.0
        self._recorded = recorded_pulse
        self.pulse = make_pulse(
            parameters.pulse, recorded_pulse, self.recorded_period_s or 0.125 / parameters.pulse.frequency_hz)
        self._medium = make_medium(parameters.medium)
        self._speed_m_s = float(group_speed(self._medium, parameters.pulse.frequency_hz))
        if is_recorded:
            check_length(self.pulse, self.recorded_period_s, float(ranges_m[-1]) / (0.5 * self._speed_m_s))
        step_m = self._step_m
        if parameters.echo.kind == 'rf':
            step_m = sampling_step(self._medium, self.pulse, parameters.pulse.frequency_hz)
        self.fold = max(1, int(np.ceil(self._step_m / step_m - 1e-9)))
        self.n_fine = (len(ranges_m) - 1) * self.fold + 1
        fine_m = self._step_m / self.fold
        for name, length_m in (('grid.range_max_m', float(ranges_m[-1])), ('pulse.frequency_hz', self.pulse_m)):
            if (steps := length_m / fine_m) > MOST_RANGES:
                raise ParameterError(name, f'{parameters[name]!r} makes {steps:.3g} steps of {fine_m:.3g} m, which the '
                                     f"grid or the pulse's band asks for; allowed: up to {MOST_RANGES}")
        self._fine_m = np.arange(self.n_fine, dtype=float) * fine_m
        self.admission = Admission(parameters, self.pulse, self.recorded_period_s, self._speed_m_s, float(ranges_m[-1]),
                                   fine_m)
        if parameters.echo.kind == 'rf' and (self.recorded_period_s or not is_recorded):
            check_band(parameters, self.pulse)
        self._filters: dict[_Key, _Ears] = {}
        self._begun: set[_Key] = set()
        self._shape: NDArray[np.complex128] | None = None
        self._noise_matters = parameters.free_area.false_alarm > 0.0 or parameters.free_area.model == 'grid'

    def at(self, period_s: float) -> 'Listener':
        """Return one that takes a recorded pulse for one of this sample period [s]; this one where that is known.

        Raises
        ------
        BadPing
            Where the pulse cannot have that.
        """
        is_open = self._parameters.pulse.kind == 'file' and not self.recorded_period_s
        if not is_open or not (isfinite(period_s) and period_s > 0.0):
            return self
        try:
            return Listener(self._parameters, self._ranges_m, self._recorded, self._later, period_s)
        except ParameterError as error:
            raise BadPing('bad_shape', f'with a sample period of {period_s:g} s, {error}') from error

    def hear(self, ping: Ping, finely: bool = True) -> Heard:
        """Eq. (3) of a ping that `admission` let pass; zero within the blanking and beyond the last useful range.

        Not finely: without the echo on the fine axis, which takes most of the work, and without the noise where
        nothing else depends on it; then that and the confidence are nan.
        """
        correlate, gauge, front_end, width_m, _ = self._filter(ping)
        samples = front_end.levelled(ping.samples)
        used = front_end.limited(samples, self.admission.blanked_s(ping))
        echo = correlate(used, finely)
        blanking_m, last_m = self.admission.blanking_m(ping), ping.range_max_m or np.inf
        axis_m = self._fine_m if finely else self._ranges_m
        echo[np.searchsorted(axis_m, last_m * (1.0 + 1e-9), 'right'):] = 0.0
        envelope = np.abs(echo[:: self.fold] if finely else echo)
        noise = np.nan
        if finely or self._noise_matters:
            gauged = gauge(samples, used) if self._parameters.echo.kind == 'rf' else None
            noise = noise_from_envelope(envelope, ping.samples.size) if gauged is None else gauged
        useful = int(np.searchsorted(self._ranges_m, last_m * (1.0 + 1e-9), 'right'))
        rho, sure = self._closest(envelope[:useful], noise, blanking_m, width_m)
        echo[:np.searchsorted(axis_m, blanking_m * (1.0 - 1e-9))] = 0.0
        envelope[:np.searchsorted(self._ranges_m, blanking_m * (1.0 - 1e-9))] = 0.0
        if self._parameters.front_end.flat_spreading:
            envelope *= ((self._ranges_m / self._ranges_m[-1]) ** self._medium.spreading).astype(np.float32)
        return Heard(echo if finely else _NO_ECHO, envelope, rho, noise, sure, correlate.heard_m)

    def freed(self, ping: Ping, known_hz: Sequence[float] = ()) -> tuple[Ping, Freed]:
        """Return a ping that `admission` let pass without impulses and lines, and what these were.

        Lines that other pings have are at `known_hz` [Hz].
        """
        interference = self._filter(ping)[4]
        freed = interference(ping.samples, known_hz) if interference else Freed(ping.samples)
        return ping if freed.samples is ping.samples else dataclasses.replace(ping, samples=freed.samples), freed

    def _closest(
        self, envelope: NDArray[np.floating], noise: float, blanking_m: float, width_m: float
    ) -> tuple[float, float]:
        """Closest range [m] and the confidence in it."""
        false_alarm = self._parameters.free_area.false_alarm
        axis = noise, self._step_m, blanking_m, width_m
        rho = (first_echo(envelope, *axis, false_alarm) if false_alarm
               else closest_range(envelope, self._step_m, blanking_m))
        return rho, confidence(envelope, *axis, rho) if isfinite(noise) else np.nan

    def signals(self, ping: Ping, cleaned: Ping, known_hz: Sequence[float] = ()) -> Signals:
        """What `hear` makes of a ping, and what was made of it before."""
        front_end = self._filter(ping)[2]
        freed, _ = self.freed(cleaned, known_hz)
        levelled = front_end.levelled(freed.samples)
        limited = front_end.limited(levelled, self.admission.blanked_s(ping))
        steps = [('as received', ping.samples), ('without what is common', cleaned.samples),
                 ('without impulses and lines', freed.samples),
                 ('without DC, with gain over time', levelled), ('in the band, blanking muted', limited)]
        changed = [after for before, after in pairwise(steps) if after[1] is not before[1]]
        time_s = np.asarray(ping.t0_s + np.arange(ping.samples.size) * ping.period_s, dtype=float)
        heard = self.hear(freed)
        centre_s = self.pulse.centre_s
        range_m = np.asarray(0.5 * self._speed_m_s * (time_s - centre_s), dtype=float)
        return Signals((steps[0], *changed), time_s, range_m, self._ranges_m,
                       np.abs(heard.echo[::self.fold]) / heard.noise, heard.rho, self.admission.blanking_m(ping))

    @property
    def pulse_s(self) -> float:
        """Duration of the pulse [s]."""
        return self.pulse.duration_s

    @property
    def pulse_m(self) -> float:
        """The range that the pulse takes up [m]."""
        return 0.5 * self._speed_m_s * self.pulse_s

    @property
    def shape(self) -> PulseShape:
        """The compressed pulse on the echoes' axis; the same for all pings but for their sampling."""
        if self._shape is None:
            period_s = self.recorded_period_s or 0.125 / self._parameters.pulse.frequency_hz
            nominal = Ping(0, np.zeros(int(self.pulse.duration_s / period_s) + 64), period_s)
            self._shape = self._correlation(_key(nominal)).autocorrelation
        return PulseShape.of(self._shape, float(self._fine_m[1]))

    def ready(self, ping: Ping) -> bool:
        """Whether `hear` answers at once; where its filter is missing, that is begun."""
        key = _key(ping)
        if key not in self._filters and key not in self._begun:
            self._begun.add(key)
            self._later(partial(self._prepare, key))
        return key in self._filters

    def _prepare(self, key: '_Key') -> None:
        try:
            pulse, magnitudes = self.pulse, self._parameters.echo.kind == 'envelope'
            made = (self._correlation(key), NoiseGauge(self._medium, pulse, *key[:2]),
                    FrontEnd(self._parameters.front_end, magnitudes, *key, pulse.duration_s), self.shape.width_m,
                    None if magnitudes else Interference(pulse, *key[:2]))
        finally:
            self._begun.discard(key)
        if len(self._filters) == _FILTERS:
            del self._filters[next(iter(self._filters))]
        self._filters[key] = made

    def _filter(self, ping: Ping) -> '_Ears':
        key = _key(ping)
        if key not in self._filters:
            self._prepare(key)
        return self._filters[key]

    def _correlation(self, key: '_Key') -> EchoFilter:
        pulse = self.pulse
        if self._parameters.echo.kind == 'rf':
            front_end = self._parameters.front_end
            wiener_noise = front_end.wiener_noise if front_end.filter == 'wiener' else None
            return MatchedFilter(self._medium, pulse, self._fine_m, *key, self.fold, wiener_noise)
        return EnvelopeFilter(self._speed_m_s, pulse.centre_s, self._fine_m, *key)


_Key: TypeAlias = tuple[int, float, float]
"""Samples, sample period [s] and time of the first sample [s]."""

_Ears: TypeAlias = tuple[EchoFilter, NoiseGauge, FrontEnd, float, Interference | None]
"""All that pings of one length, period and start are heard with; the float is the width of a cell of range [m]."""


def _key(ping: Ping) -> _Key:
    # Seven digits: what float32 fields hold, so that their rounding does not make a new filter of every ping.
    return ping.samples.size, float(f'{ping.period_s:.6e}'), round(ping.t0_s, 10)
