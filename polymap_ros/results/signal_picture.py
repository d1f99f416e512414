"""signals.png: the pings as received, after each step of the front end, and as eq. (3) hears them."""

import io
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import BadPing
from polymap_ros.hearing.signals import Signals
from polymap_ros.mapping.mapper import PolygonMapper

_FLOOR_DB = -50.0
_BLANKED = {'color': '#d62728', 'alpha': 0.12, 'linewidth': 0.0}
_EMISSION = {'color': '#1f77b4', 'linestyle': (0, (4, 3)), 'linewidth': 1.0}
_RHO = {'color': '#2ca02c', 'linewidth': 1.4}


def signals_png(mapper: PolygonMapper, pings: Sequence[Ping]) -> bytes:
    """Draw pings as they are heard with what the mapper knows now.

    Above, all of them over range, a row each: as received, and the envelope e(r) of eq. (3) in units of the noise.
    What stays at one range in all rows is no wall. Below, the middle ping: its samples after each step, over the range
    of a wall whose echo's middle is there, and its envelope with the closest range (green). Red: the blanking; blue:
    emission, t = 0, which `echo.t0_s` places.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    every = []
    for ping in pings:
        with suppress(BadPing):
            every.append(mapper.signals(ping))
    figure = Figure(figsize=(11.0, 9.5), layout='constrained')
    FigureCanvasAgg(figure)
    if not every:
        figure.text(0.5, 0.5, 'no ping can be used', ha='center')
    else:
        middle = every[len(every) // 2]
        alike = [each for each in every if each.range_m.shape == middle.range_m.shape]
        heights = 1.0, 0.6 + 0.35 * len(middle.steps)
        images, traces = np.asarray(figure.subfigures(2, 1, height_ratios=heights)).tolist()
        _draw_images(images, alike)
        _draw_traces(traces, middle, len(every) // 2)
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', dpi=110)
    return buffer.getvalue()


def _draw_images(figure: Any, every: list[Signals]) -> None:
    first = every[0]
    received = np.abs([each.steps[0][1] for each in every])
    heard = np.array([each.envelope for each in every])
    left, right = figure.subplots(1, 2)
    limits = first.range_m[0], first.range_m[-1]
    for axes, rows, extent, title, label in (
            (left, _decibels(received, received.max()), limits, 'as received', '|sample| [dB of the largest]'),
            (right, _decibels(heard, 1.0), (0.0, first.axis_m[-1]), 'as heard: e(r)', 'e(r) over the noise [dB]')):
        low = max(_FLOOR_DB, float(rows.min())) if axes is left else 0.0
        drawn = axes.imshow(rows, aspect='auto', origin='lower', extent=(*extent, -0.5, len(rows) - 0.5), vmin=low,
                            cmap='viridis', interpolation='nearest')
        figure.colorbar(drawn, ax=axes, label=label, pad=0.02)
        axes.set_title(title, fontsize='medium')
        axes.set_xlim(_left(first), first.axis_m[-1])
        axes.set_xlabel('range [m]')
        axes.set_ylabel('ping')
        _mark(axes, first)


def _draw_traces(figure: Any, ping: Signals, number: int) -> None:
    rows = figure.subplots(len(ping.steps) + 1, 1, sharex=True)
    for axes, (name, samples) in zip(rows, ping.steps, strict=False):
        axes.plot(ping.range_m, samples, color='black', linewidth=0.6)
        axes.set_ylabel('sample')
        axes.set_title(f'ping {number}: {name}', fontsize='small', loc='left', pad=2)
        _mark(axes, ping)
    heard = rows[-1]
    heard.plot(ping.axis_m, ping.envelope, color='black', linewidth=0.9)
    heard.set_title(f'ping {number}: e(r) over the noise', fontsize='small', loc='left', pad=2)
    heard.set_ylabel('e(r)')
    _mark(heard, ping)
    if np.isfinite(ping.rho):
        heard.axvline(ping.rho, **_RHO, label=f'closest range {ping.rho:.3f} m')
    heard.legend(loc='lower right', bbox_to_anchor=(1.0, 0.98), ncols=3, fontsize='small', frameon=False)
    heard.set_xlim(_left(ping), ping.axis_m[-1])
    heard.set_xlabel('range of a wall whose echo is centred there [m]')
    speed, emission_m = _half_speed(ping), _emission_m(ping)
    times = rows[0].secondary_xaxis('top', functions=(
        lambda r: 1e3 * (r - emission_m) / speed, lambda t: 1e-3 * t * speed + emission_m))
    times.set_xlabel('time after emission [ms]')


def _mark(axes: Any, ping: Signals) -> None:
    """The blanking, and where t = 0 is on the axis of ranges."""
    axes.axvspan(_left(ping), ping.blanking_m, **_BLANKED, label='blanking')
    axes.axvline(_emission_m(ping), **_EMISSION, label='emission, t = 0')


def _half_speed(ping: Signals) -> float:
    return float((ping.range_m[-1] - ping.range_m[0]) / (ping.time_s[-1] - ping.time_s[0]))


def _emission_m(ping: Signals) -> float:
    return float(ping.range_m[0] - ping.time_s[0] * _half_speed(ping))


def _left(ping: Signals) -> float:
    """Left end of the axis of ranges: a little before the first sample and emission, whichever is first."""
    return min(float(ping.range_m[0]), _emission_m(ping)) - 0.01 * float(ping.axis_m[-1])


def _decibels(values: NDArray[np.floating], reference: float) -> NDArray[np.float64]:
    tiny = np.finfo(float).tiny
    return np.asarray(20.0 * np.log10(np.maximum(values, 10.0 ** (_FLOOR_DB / 20.0) * max(reference, tiny))
                                      / max(reference, tiny)))
