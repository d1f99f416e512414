"""Eq. (1): the samples that a scene's pings receive, synthesised in the frequency domain."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from polymap_ros.acoustics.medium import ConstantSpeed, Medium, group_speed, make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import Pulse, make_pulse
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.jit import kernel
from polymap_ros.simulation.diffraction import diffracted, diffracting_corners
from polymap_ros.simulation.edges import EDGES_STREAM, Edges, delays
from polymap_ros.simulation.faults import FIRST_STREAM, RINGING_STREAM, Arrivals, directed, first_echo_faults, ringing
from polymap_ros.simulation.inside import Hole
from polymap_ros.simulation.interference import INTERFERENCE_STREAM, interference
from polymap_ros.simulation.propagation import ways
from polymap_ros.simulation.reflectors import heard_images
from polymap_ros.simulation.round_paths import heard_paths
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.transducer import Transduced

BAND_FLOOR = 1e-3
"""Frequencies at which the echo is weaker than this, relative to its strongest, are left out."""

HeardAt: TypeAlias = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
"""From a position (2,) [m] to the lengths (m,) [m] and amplitudes (m,), before spreading, of the paths heard there;
complex where edges turn the phase."""


def simulate(scene: Scene | str, clean: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Samples of every ping of a scene: eq. (1) with the scene's gains, clutter and noise.

    Clutter is the same in every ping, and does not count for the SNR.

    Parameters
    ----------
    scene : Scene or str
        A scene; its name, or its file's, will do.
    clean : ndarray, shape (T, n_samples), optional
        Takes the place of what `noise_free` gives, where other echoes are to be heard.

    Returns
    -------
    ndarray, shape (T, n_samples)
        The A-scans, a row per ping.

    Raises
    ------
    SceneError
        For a scene that is unknown or cannot be.
    """
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    clean = noise_free(scene) if clean is None else clean
    samples = scene.gains()[:, None] * clean + _clutter(scene, clean)
    level = np.sqrt(np.mean(clean**2, axis=1, keepdims=True) * 10.0 ** (-(scene.snr_db or 0.0) / 10.0))
    if scene.faults.lines or scene.faults.impulses:
        generator = scene.generator(INTERFERENCE_STREAM)
        samples = samples + interference(scene.faults, generator, clean, level, scene.period_s)
    heard = np.asarray(samples if scene.snr_db is None else samples + level * scene.noise())
    return heard if scene.echo_kind == 'rf' else _magnitudes(heard)


def _magnitudes(heard: NDArray[np.float64]) -> NDArray[np.float64]:
    """The magnitude of the analytic signal, row by row."""
    from scipy.signal import hilbert  # takes as long to load as all the rest of scipy that is used

    return np.asarray(np.abs(hilbert(heard)))


def pings(scene: Scene, clean: NDArray[np.float64] | None = None) -> list[Ping]:
    """The scene's pings as a recording holds them: samples in single precision, stamped; `clean` as in `simulate`."""
    samples = simulate(scene, clean).astype(np.float32)
    return [Ping(int(stamp), ping, scene.period_s, scene.t0_s, frame_id='sensor')
            for stamp, ping in zip(scene.stamps_ns, samples, strict=True)]


def noise_free(scene: Scene, heard: HeardAt | None = None) -> NDArray[np.float64]:
    """Eq. (1) without noise and clutter and at gain 1, shape (T, n_samples).

    `heard` takes the place of the scene's walls, and of the distance between emitter and receiver.
    """
    medium = make_medium(scene.medium)
    paths = [Arrivals.in_order(*heard(position)) for position in scene.positions] if heard else _heard(scene)
    if scene.edge_fading == 'fresnel':
        paths = _with_diffracted(scene, medium, paths)
    paths = first_echo_faults(scene.faults, scene.generator(FIRST_STREAM), paths, medium.spreading)
    clean = _synthesised(scene, medium, paths)
    if scene.faults.second_mode:
        other = _synthesised(scene, ConstantSpeed(scene.faults.second_mode_speed_m_s, medium.spreading), paths)
        clean = clean + scene.faults.second_mode * np.sqrt(np.mean(clean**2) / np.mean(other**2)) * other
    return clean


def _heard(scene: Scene) -> list[Arrivals]:
    """The paths from the emitter over the walls to the receiver."""
    if scene.has_inside:
        paths = _heard_among_all(scene)
    else:
        ends = zip(*scene.ends, scene.poses[:, 2].tolist(), strict=True)
        paths = [_over_floor_and_ceiling(scene, *_over_walls(scene, *each)) for each in ends]
    slowness = scene.propagation.slowness(len(paths))
    return [heard._replace(length_m=factor * heard.length_m) for factor, heard in zip(slowness, paths, strict=True)]


def _over_walls(
    scene: Scene, emitter: NDArray[np.float64], receiver: NDArray[np.float64], yaw: float
) -> tuple[NDArray[np.float64], NDArray[np.complex128], NDArray[np.int64]]:
    """Lengths, amplitudes and orders of the paths over walls, and of the straight one, which is of order 0."""
    stretch = scene.propagation.stretch
    vertices, source, end = scene.vertices @ stretch, stretch @ emitter, stretch @ receiver
    if scene.edges.are_bent:
        outline = scene.edges.outline(vertices)
        amplitude, found = outline.paths(source, end, scene.order, np.asarray(scene.reflection))
        length, order = np.empty(len(found)), np.array([len(way.walls) for way in found], np.int64)
    else:
        images = visible_images(vertices, source, scene.order, scene.reflection, end)
        length, amplitude, order = images.distance_m, images.amplitude.astype(complex), images.order
        found = ways(images, vertices, end) if _needs_ways(scene) else []
    if found:
        back = np.linalg.inv(stretch)
        found = [way._replace(points=way.points @ back) for way in found]
        length = np.array([scene.propagation.length_m(way.legs) for way in found])
        delay = delays(scene.edges, scene.generator(EDGES_STREAM), scene.vertices, found)
        amplitude = amplitude * directed(scene.faults, yaw, found) * np.exp(-1j * delay)
    apart_m = float(np.hypot(*(receiver - emitter)))
    return np.append(length, apart_m), np.append(amplitude, 1.0), np.append(order, 0)


def _needs_ways(scene: Scene) -> bool:
    """Whether more than the length of a path counts."""
    return bool(scene.edges != Edges() or scene.propagation.anisotropy or scene.faults.directivity)


def _heard_among_all(scene: Scene) -> list[Arrivals]:
    """As `_heard`, of every sequence of the outline's, the holes' and the inner walls: by another tracer."""
    paths = []
    for emitter, receiver in zip(*scene.ends, strict=True):
        length, amplitude = among_all(scene, emitter, receiver)
        paths.append(Arrivals(np.hypot(length, scene.sensor.baseline_z_m), amplitude, np.zeros(len(length))))
    return paths


def among_all(
    scene: Scene, emitter: NDArray[np.float64], receiver: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return lengths (m,) [m] and amplitudes (m,), before spreading, of the paths over every sequence of walls."""
    if len(scene.circles):
        return heard_paths(scene.reflectors, scene.circles, emitter, receiver, scene.order)
    images, amplitude = heard_images(scene.reflectors, emitter, scene.order, receiver)
    return np.asarray(np.linalg.norm(images - receiver, axis=1)), amplitude


def _with_diffracted(scene: Scene, medium: Medium, paths: list[Arrivals]) -> list[Arrivals]:
    """Add the paths over corners to those of each ping."""
    wavenumber = float(medium.wavenumber(2.0 * np.pi * scene.pulse.frequency_hz))
    walls, corners = scene.reflectors, diffracting_corners(scene.vertices, np.asarray(scene.reflection))
    for hole in scene.holes:
        if isinstance(hole, Hole):
            corners += diffracting_corners(hole.vertices, np.asarray(hole.reflection))
    together = []
    for emitter, receiver, heard in zip(*scene.ends, paths, strict=True):
        more, over_corners = diffracted(corners, walls, emitter, receiver, scene.order, wavenumber)
        lengths = np.append(heard.length_m, np.hypot(more, scene.sensor.baseline_z_m))
        together.append(Arrivals.in_order(lengths, np.append(heard.amplitude, over_corners)))
    return together


def _over_floor_and_ceiling(
    scene: Scene, flat: NDArray[np.float64], strength: NDArray[np.complex128], order: NDArray[np.int64]
) -> Arrivals:
    """The paths that floor and ceiling make of those in the plane, which are heard themselves but for the straight one.
    """
    several = []
    for z, coefficient, bounces in scene.height.storey.images(scene.order, level=False):
        heard = (order + bounces <= scene.order) & (order + bounces > 0)
        length = np.hypot(flat[heard], scene.sensor.baseline_z_m - z)
        several.append((length, coefficient * strength[heard], scene.edges.delay_s * order[heard]))
    return Arrivals.in_order(*(np.concatenate(column) for column in zip(*several, strict=True)))


def _synthesised(scene: Scene, medium: Medium, paths: list[Arrivals]) -> NDArray[np.float64]:
    loss = scene.propagation.attenuation_np_m / scene.pulse.frequency_hz
    synthesis = Synthesis(medium, emitted(scene), scene.n_samples, scene.period_s, scene.t0_s, loss)
    return np.array([synthesis(*heard) for heard in paths])


def emitted(scene: Scene) -> Pulse:
    """Return the pulse as the medium has it."""
    pulse, faults = make_pulse(scene.pulse, scene.recorded_pulse, scene.period_s), scene.faults
    if faults.transducer_q == 0.0:
        return pulse
    centre_hz = faults.transducer_centre * scene.pulse.frequency_hz
    return Transduced(pulse, faults.transducer_q, centre_hz, faults.transducer_times)


def _clutter(scene: Scene, clean: NDArray[np.float64]) -> NDArray[np.float64]:
    """What every ping of the scene holds beside its echoes, shape (n_samples,)."""
    faults, total = scene.faults, np.zeros(scene.n_samples)
    if not (faults.direct_wave or faults.clutter):
        return total
    medium = make_medium(scene.medium)
    pulse_s = emitted(scene).duration_s
    pulse_m = 0.5 * pulse_s * float(group_speed(medium, scene.pulse.frequency_hz))
    loud = np.median(np.abs(clean).max(axis=1))
    fixed = Arrivals.in_order(np.array([2.0 * faults.clutter_m]), np.ones(1))
    rings = ringing(faults, scene.generator(RINGING_STREAM), scene.sensor.baseline_m, pulse_m, medium.spreading)
    for factor, paths in ((faults.direct_wave, rings), (faults.clutter, fixed)):
        wave = _synthesised(scene, medium, [paths])[0]
        total += factor * loud * wave / max(np.abs(wave).max(), np.finfo(float).tiny)
    return total


class Synthesis:
    r"""Echoes of image sources, sampled over a window: z(w) = s(w) sum_m a_m g(d_m, w).

    The spectrum is summed over a period of at least twice the window. A component of an image that arrives, by
    its group delay d_m / v(w), after the end of the window is faded out towards the end of the period, so that
    nothing wraps into the window; an image too far to be heard is thereby left out at all frequencies.

    Parameters
    ----------
    medium : Medium
        Dispersion, excitability and spreading of g.
    pulse : Pulse
        Excitation s(t).
    n_samples : int
        Samples of the window.
    period_s : float
        Sample period [s].
    t0_s : float
        Time of the first sample after emission [s].
    loss : float
        What the way takes, in proportion to frequency [Np / (m Hz)].
    """

    def __init__(
        self, medium: Medium, pulse: Pulse, n_samples: int, period_s: float, t0_s: float = 0.0, loss: float = 0.0
    ) -> None:
        end_s = t0_s + n_samples * period_s
        start = min(t0_s, 0.0)
        length_s = 2.0 * (end_s - start + pulse.duration_s)
        self._n_samples = n_samples
        self._period_s = period_s
        self._spreading = medium.spreading
        self._size = scipy.fft.next_fast_len(int(np.ceil(length_s / period_s)), real=True)
        omega = 2.0 * np.pi * np.arange(1, self._size // 2) / (self._size * period_s)
        strength = pulse.spectrum(omega) * medium.excitability(omega)
        inside = np.flatnonzero(np.abs(strength) > BAND_FLOOR * np.abs(strength).max())
        band = slice(inside[0], inside[-1] + 1)
        omega = omega[band]
        self._bins = slice(band.start + 1, band.stop + 1)
        self._strength = strength[band] * np.exp(1j * omega * t0_s) / period_s
        self._omega, self._wavenumber = omega, medium.wavenumber(omega) - 1j * loss / (2.0 * np.pi) * omega
        speed = group_speed(medium, omega / (2.0 * np.pi))
        self._heard_m = speed * end_s
        self._faded_m = speed * (start + self._size * period_s - pulse.duration_s)

    def __call__(
        self, distance_m: NDArray[np.float64], amplitude: NDArray[np.float64],
        late_s: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Samples (n_samples,) of images at distances (m,) [m] with amplitudes (m,) before spreading, and late by (m,)
        [s].
        """
        near = distance_m < self._faded_m.max()
        weights = amplitude[near] * distance_m[near] ** -self._spreading
        late = np.zeros(len(weights)) if late_s is None else late_s[near]
        spectrum = np.zeros(self._size // 2 + 1, dtype=complex)
        for delay_s in np.unique(late):
            so_late = late == delay_s
            spectrum[self._bins] += self._strength * np.exp(-1j * self._omega * delay_s) * _sum_of_images(
                self._wavenumber, self._heard_m, self._faded_m, distance_m[near][so_late],
                weights[so_late].astype(complex))
        return np.asarray(scipy.fft.irfft(spectrum, self._size)[:self._n_samples])


@kernel
def _sum_of_images(
    wavenumber: NDArray[np.complex128],
    heard_m: NDArray[np.float64],
    faded_m: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    weights: NDArray[np.complex128],
) -> NDArray[np.complex128]:
    """Sum over m of weights_m exp(-j k d_m) at each k, faded from 1 at heard_m to 0 at faded_m."""
    total = np.zeros(len(wavenumber), dtype=np.complex128)
    for i in range(len(wavenumber)):
        sum_of_all = 0.0j
        for m in range(len(distance_m)):
            d = distance_m[m]
            if d < faded_m[i]:
                weight = weights[m]
                if d > heard_m[i]:
                    weight *= 0.5 + 0.5 * np.cos(np.pi * (d - heard_m[i]) / (faded_m[i] - heard_m[i]))
                phase, left = wavenumber[i].real * d, np.exp(wavenumber[i].imag * d)
                sum_of_all += weight * left * complex(np.cos(phase), -np.sin(phase))
        total[i] = sum_of_all
    return total
