"""One call from arrays to the answer."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.acoustics.ping import Ping, row_of
from polymap_ros.acoustics.pulse import RecordedPulse, problem_of
from polymap_ros.errors import UsageError
from polymap_ros.geometry.pose import FARTHEST_M, Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.pulse_file import read_pulse
from polymap_ros.solvers.estimate import Estimate

_LAST_S = 2.0**63 * 1e-9
"""Stamps are whole nanoseconds in 64 bits."""

_WHOLE_TURN = 2.0 * np.pi + 1e-6
"""From one ping to the next no heading changes by more, wrapped or not [rad]."""

_SHOWN = 80
"""Characters of a wrong argument that are shown."""


def map_polygon(
    poses: ArrayLike, samples: ArrayLike | Sequence[ArrayLike], *, period_s: float, stamps_s: ArrayLike | None = None,
    t0_s: float = 0.0, parameters: Parameters | Mapping[str, object] | None = None,
    recorded_pulse: RecordedPulse | ArrayLike | None = None,
) -> Estimate:
    """Find the polygon around a robot from its poses and the echoes that it heard there.

    Parameters
    ----------
    poses : array_like, shape (T, 3)
        x, y [m] and heading [rad] of the base at each emission.
    samples : array_like, shape (T, n), or T rows of any lengths
        An A-scan per pose: the signed signal, or its magnitude where `echo.kind` is ``envelope``.
    period_s : float
        Sample period [s].
    stamps_s : array_like, shape (T,), optional
        Times of emission, rising [s]; default: a second apart.
    t0_s : float, optional
        Time of the first sample after emission [s].
    parameters : Parameters, or a mapping of groups as `Parameters.of` takes them, optional
        Default: those of a 6 mm aluminium plate and a burst of two cycles at 100 kHz.
    recorded_pulse : RecordedPulse or array_like, shape (k,), optional
        The pulse at the samples' period, in place of that of the parameters; default: with ``pulse.kind: file`` that of
        `pulse.path`.

    Returns
    -------
    Estimate
        Its `polygon` is None where none closes; `status`, `walls`, `alternatives` and `cautions` then say more.

    Raises
    ------
    UsageError
        Names the argument that cannot be, or arrays that do not fit each other; where no ping can be used, the reason.
    ParameterError
        For parameters that do not fit each other.
    """
    parameters = _parameters(parameters)
    places = _numbers('poses', poses)
    _check_poses(places)
    rows = _rows(samples)
    times = np.arange(len(places), dtype=float) if stamps_s is None else _numbers('stamps_s', stamps_s)
    if len(rows) != len(places) or times.shape != (len(places),):
        raise UsageError(f'{len(places)} poses, {len(rows)} rows of samples and {times.size} stamps; allowed: as many')
    _check_stamps(times)
    period_s = _seconds('period_s', period_s, lambda number: number > 0.0, 'above 0')
    t0_s = _seconds('t0_s', t0_s, lambda number: abs(number) <= 100.0, 'up to 100 either way')
    pulse = read_pulse(parameters) if recorded_pulse is None else _pulse(recorded_pulse)
    # A pose is given for every emission, so that no gap between them has to be bridged.
    mapper = PolygonMapper(parameters.replaced({'odometry.max_gap_s': 1e9}), pulse)
    for second, place, row in zip(times.tolist(), places.tolist(), rows, strict=True):
        ping = Ping(round(1e9 * (second + t0_s)), row, period_s, t0_s)
        mapper.add_pose(ping.emission_ns, Pose(*place))
        mapper.add_ping(ping)
    mapper.finish()
    if not mapper.counts.used:
        reason = max(mapper.counts.dropped, key=lambda key: (mapper.counts.dropped[key], key))
        raise UsageError(f'no ping can be used, most as {reason}: {mapper.intake.last_drop_texts.get(reason, "")}')
    return mapper.solve()


def _parameters(given: object) -> Parameters:
    if given is None or isinstance(given, Parameters):
        return given or Parameters()
    if not isinstance(given, Mapping):
        raise UsageError(f"parameters: found {_shown(given)}; allowed: Parameters, or a mapping such as "
                         "{'medium': {'thickness_m': 0.005}}")
    return Parameters.of(given)


def _check_poses(places: NDArray[np.float64]) -> None:
    if places.ndim != 2 or places.shape[1] != 3 or not len(places) or not np.isfinite(places).all():
        raise UsageError(f'poses: found shape {places.shape}; allowed: finite x, y and heading of each ping, (T, 3)')
    if (farthest_m := np.abs(places[:, :2]).max()) > FARTHEST_M:
        raise UsageError(f'poses: found {farthest_m:g} m; allowed: x and y up to {FARTHEST_M:g} m')
    turned = np.abs(np.diff(places[:, 2]))
    if len(turned) and turned.max() > _WHOLE_TURN:
        raise UsageError(f'poses: the heading changes by {turned.max():g} from row {int(turned.argmax())} to the next; '
                         'headings are in radians (np.deg2rad of degrees)')


def _numbers(name: str, given: ArrayLike) -> NDArray[np.float64]:
    try:
        return np.asarray(_unmasked(given), dtype=float)
    except (TypeError, ValueError) as error:
        raise UsageError(f'{name}: found {_shown(given)}; allowed: an array of numbers') from error


def _check_stamps(times: NDArray[np.float64]) -> None:
    if not np.isfinite(times).all() or np.any(np.diff(times) <= 0.0):
        raise UsageError('stamps_s: found times that do not rise; allowed: finite and rising')
    if np.abs(times).max() >= _LAST_S - 1e3:
        raise UsageError(f'stamps_s: found {np.abs(times).max():g} s; allowed: below {_LAST_S:.3g} s, in seconds')


def _seconds(name: str, given: object, can_be: Callable[[float], bool], allowed: str) -> float:
    if isinstance(given, Real) and not isinstance(given, bool) and isfinite(number := float(given)) and can_be(number):
        return number
    raise UsageError(f'{name}: found {_shown(given)}; allowed: a number of seconds, {allowed}')


def _unmasked(given: Any) -> Any:
    """What is masked is not known: nan."""
    return np.ma.filled(given.astype(float), np.nan) if isinstance(given, np.ma.MaskedArray) else given


def _rows(samples: Any) -> list[NDArray[Any]]:
    if hasattr(samples, 'to_numpy'):  # a table, which gives its columns one by one
        samples = samples.to_numpy()
    try:
        rows = [row_of(_unmasked(row)) for row in samples]
    except TypeError as error:
        raise UsageError(f'samples: found {_shown(samples)}; allowed: a row of numbers for each pose') from error
    for row in rows:
        if row.dtype.kind in 'OUSMm':
            raise UsageError(f'samples: found {_shown(row.tolist())} of type {row.dtype}; allowed: numbers')
    return rows


def _shown(value: object) -> str:
    """The beginning of a repr, in one line."""
    text = ' '.join(repr(value).split())
    return text if len(text) <= _SHOWN else f'{text[:_SHOWN]}...'


def _pulse(given: RecordedPulse | ArrayLike) -> RecordedPulse:
    pulse = given if isinstance(given, RecordedPulse) else RecordedPulse(_numbers('recorded_pulse', given))
    if problem := problem_of(pulse.recorded):
        raise UsageError(f'recorded_pulse: {problem}')
    return pulse
