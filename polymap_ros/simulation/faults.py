"""What a real device and its odometry do wrong, as options of a scene. Everything is off by default."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.simulation.odometry import LEVELS
from polymap_ros.simulation.propagation import Way
from polymap_ros.specification import Group, parameter

SPEED_OF_S0_M_S = 5264.0
"""Group speed of S0 at 100 kHz in 6 mm of aluminium."""

FIRST_STREAM, RINGING_STREAM = 5, 7
"""Streams of a scene's random numbers that draw first echoes' faults, and the ringing."""

_RINGS = 12
"""Arrivals that make up the ringing after the direct wave."""
_NEAREST_M = 5e-4
"""Half the way from emitter to receiver where they are in one place."""
_DECAY = 3.0
"""They fade by this many nepers towards their end."""

class Arrivals(NamedTuple):
    """The paths that a ping hears, nearest first.

    Attributes
    ----------
    length_m : ndarray, shape (m,)
        Their lengths [m].
    amplitude : ndarray, shape (m,)
        Their amplitudes before spreading; complex where walls turn the phase.
    late_s : ndarray, shape (m,)
        By how much later they are heard than for their length [s].
    """

    length_m: NDArray[np.float64]
    amplitude: NDArray[Any]
    late_s: NDArray[np.float64]

    @classmethod
    def in_order(
        cls, length_m: NDArray[np.float64], amplitude: NDArray[Any], late_s: NDArray[np.float64] | None = None
    ) -> 'Arrivals':
        """Return paths in order of their lengths, none of them late unless that is given."""
        nearest = np.argsort(length_m, kind='stable')
        late = np.zeros(len(nearest)) if late_s is None else late_s[nearest]
        return cls(length_m[nearest], amplitude[nearest], late)


@dataclass(frozen=True)
class Faults(Group):
    """Faults of one scene; amplitudes are factors, of which 10 is 20 dB."""

    PREFIX = 'faults.'
    missing_first: float = parameter(0.0, 'share of the pings of which the nearest echo is not heard',
                                     minimum=0.0, maximum=1.0)
    false_first: float = parameter(
        0.0, 'share of the pings with a false echo, as strong as the nearest true one, at a range drawn uniform from '
        '0.2 to 0.9 of its range', minimum=0.0, maximum=1.0)
    direct_wave: float = parameter(
        0.0, "peak of the direct wave and its ringing, over the median of the pings' strongest echoes", minimum=0.0,
        maximum=1e6)
    direct_wave_m: float = parameter(0.15, 'range at which the ringing is over', unit='m', above=0.0,
                                     maximum=1e6)
    clutter: float = parameter(0.0, 'peak of an echo that every ping has at one range, over the same', minimum=0.0,
                               maximum=1e6)
    clutter_m: float = parameter(0.4, 'its range', unit='m', above=0.0, maximum=1e6)
    second_mode: float = parameter(
        0.0, 'amplitude of the echoes of a second, dispersion-free mode over those of the first, on average over the '
        'run: leaking S0', minimum=0.0, maximum=1e6)
    second_mode_speed_m_s: float = parameter(SPEED_OF_S0_M_S, 'its speed', unit='m/s', above=0.0, maximum=1e6)
    lines: int = parameter(0, 'narrow-band lines of motors and supplies, each with another phase in every ping',
                           minimum=0, maximum=16)
    line_hz: float = parameter(90e3, 'frequency of the first; each further one is 1.3 times higher', unit='Hz',
                               above=0.0, maximum=1e12)
    line_db: float = parameter(0.0, "power of each over the echoes' mean power", unit='dB', minimum=-300.0,
                               maximum=300.0)
    impulses: float = parameter(0.0, 'share of the samples with an impulse, as of a relay', minimum=0.0, maximum=1.0)
    impulse_sigma: float = parameter(30.0, "their strength, in deviations of the noise, or of the echoes where "
                                     'there is none', minimum=0.0, maximum=1e6)
    impulse_width: float = parameter(0.0, 'their width (standard deviation); 0: one sample each', unit='samples',
                                     minimum=0.0, maximum=1e3)
    noise_colour: float = parameter(0.0, "how much of a sample's noise the next one takes over; 0: white noise",
                                    minimum=0.0, maximum=0.999)
    directivity: float = parameter(
        0.0, 'b of the amplitude 1 + b cos(phi) in the direction phi from the x axis of the base, of emitter and of '
        'receiver', minimum=0.0, maximum=1.0)
    transducer_q: float = parameter(0.0, 'quality of a resonant transducer that the pulse goes through; 0: none',
                                    minimum=0.0, maximum=1e3)
    transducer_centre: float = parameter(1.0, "its frequency over the pulse's", above=0.0, maximum=100.0)
    transducer_times: int = parameter(1, 'how often: twice where emitter and receiver are alike', minimum=1, maximum=4)
    yaw_drift_deg_m: float = parameter(0.0, 'turn of the reported heading per metre travelled', unit='deg/m',
                                       minimum=-1e6, maximum=1e6)
    odometry_scale: float = parameter(1.0, 'reported over true distance', above=0.0, maximum=1e6)
    drift: str = parameter('none', 'wheel odometry as it is, beside the two above: random walks of distance and '
                           'heading, a share of every turn, and a steady part; wheels: two that err, each by itself',
                           choices=('none', *LEVELS))
    slip_m: float = parameter(0.0, 'jump of the reported place, once, in any direction', unit='m', minimum=0.0,
                              maximum=1e6)
    slip_deg: float = parameter(0.0, 'jump of the reported heading there', unit='deg', minimum=-1e6, maximum=1e6)


def first_echo_faults(
    faults: Faults, generator: np.random.Generator, paths: list[Arrivals], spreading: float
) -> list[Arrivals]:
    """Every ping's paths with first echoes taken away or false ones added."""
    if not (faults.missing_first or faults.false_first):
        return paths
    draws = generator.uniform(size=(len(paths), 3))
    changed = []
    for heard, (missing, false, place) in zip(paths, draws, strict=True):
        first, later = Arrivals(*(column[:1] for column in heard)), heard
        if missing < faults.missing_first:
            later = Arrivals(*(column[1:] for column in heard))
        if false < faults.false_first:
            share = 0.2 + 0.7 * place
            nearer = Arrivals(share * first.length_m, share**spreading * first.amplitude, first.late_s)
            later = Arrivals(*(np.concatenate(pair) for pair in zip(nearer, later, strict=True)))
        changed.append(later)
    return changed


def directed(faults: Faults, yaw: float, found: list[Way]) -> NDArray[np.float64]:
    """What emitter and receiver, at a heading of the base [rad], make of the amplitudes of paths (m,): factors."""
    ends = np.array([(way.legs[0], -way.legs[-1]) for way in found]).reshape(-1, 2, 2)
    phi = np.arctan2(ends[..., 1], ends[..., 0]) - yaw
    return np.asarray((1.0 + faults.directivity * np.cos(phi)).prod(axis=1))


def ringing(
    faults: Faults, generator: np.random.Generator, baseline_m: float, pulse_m: float, spreading: float
) -> Arrivals:
    """The direct wave, from emitter to receiver, and its ringing.

    It is over before `direct_wave_m`.

    Parameters
    ----------
    faults : Faults
        How long it lasts.
    generator : numpy.random.Generator
        Draws the arrivals.
    baseline_m : float
        From emitter to receiver [m].
    pulse_m : float
        Range that the pulse takes up [m].
    spreading : float
        Exponent of the amplitude's decay, which the amplitudes make up for.
    """
    first_m = max(0.5 * baseline_m, _NEAREST_M)
    end_m = max(faults.direct_wave_m - pulse_m, 0.1 * faults.direct_wave_m)
    range_m = np.append(first_m, first_m + (end_m - first_m) * np.sort(generator.uniform(0.2, 1.0, _RINGS)))
    sign = np.append(1.0, generator.choice((-1.0, 1.0), _RINGS))
    amplitude = sign * np.exp(-_DECAY * range_m / end_m)
    return Arrivals.in_order(2.0 * range_m, amplitude * (2.0 * range_m) ** spreading)
