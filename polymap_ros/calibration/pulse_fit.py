"""The pulse that the echoes have in truth, as samples that the next replay can be given.

`solvers.evidence.pulse_search` finds it with the walls, as a filter of the nominal pulse over the wavenumber. Here that
filter makes samples: each frequency has the wavenumber that the medium gives it.
"""

from dataclasses import dataclass

import numpy as np

from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.pulse import RecordedPulse, make_pulse
from polymap_ros.calibration.session import Session
from polymap_ros.calibration.stages import Refusal
from polymap_ros.errors import ParameterError
from polymap_ros.hearing.pulse_shape import PulseShape
from polymap_ros.solvers.evidence.heard_pulse import AFTER_CYCLES, HeardPulse
from polymap_ros.solvers.evidence.pulse_search import FirstGuess, adapted, may_be_told
from polymap_ros.solvers.evidence.ring_search import may_tell_rings


@dataclass(frozen=True)
class FittedPulse:
    """A pulse that makes the echoes agree.

    Parameters
    ----------
    recorded : RecordedPulse
        At the pings' sample period.
    explained : float
        Share of the echoes' power that the polygon explains by it.
    """

    recorded: RecordedPulse
    explained: float


def fitted_pulse(session: Session) -> FittedPulse | Refusal:
    """Return the pulse by which walls explain the echoes, or why there is none."""
    if session.parameters.echo.kind != 'rf':
        return Refusal('the echoes are magnitudes (echo.kind: envelope), which have no pulse')
    if len({(ping.samples.size, ping.period_s, ping.t0_s) for ping in session.pings}) != 1:
        return Refusal('the pings differ in length, sample period or start')
    try:
        search = session.search(session.parameters)
    except ParameterError as error:  # too little is left to listen to
        return Refusal(str(error))
    rings = may_tell_rings(search, session.parameters.solver.outline)
    own = adapted(search, FirstGuess.of(search), rings) if may_be_told(search) else None
    if own is None:
        return Refusal('by no pulse that was tried do walls explain the echoes')
    return FittedPulse(_recorded(own.pulse, search.data.pulse, session), own.found.explained)


def _recorded(pulse: HeardPulse, nominal: PulseShape, session: Session) -> RecordedPulse:
    """The samples of a pulse, at the pings' period."""
    parameters, period_s = session.parameters, session.pings[0].period_s
    emitted = make_pulse(parameters.pulse, None, period_s)
    longest_s = emitted.duration_s + AFTER_CYCLES / parameters.pulse.frequency_hz
    size = 4 * (int(longest_s / period_s) + 2)
    omega = 2.0 * np.pi * np.fft.rfftfreq(size, period_s)
    spectrum = emitted.spectrum(omega) * pulse.response(make_medium(parameters.medium).wavenumber(omega), nominal)
    wave = np.fft.irfft(spectrum, size)[:size // 4]
    return RecordedPulse(wave / np.abs(wave).max(), period_s)
