"""What polymap_replay does about medium and odometry: finds them when asked, and looks after them when in doubt."""

from typing import TYPE_CHECKING

from polymap_ros.commands import console

if TYPE_CHECKING:
    from polymap_ros.calibration.pulse_fit import FittedPulse
    from polymap_ros.calibration.session import Session
    from polymap_ros.calibration.stages import Fit, Refusal
    from polymap_ros.cautions import Caution
    from polymap_ros.solvers.estimate import Estimate


def found(session: 'Session', what: str, name: str) -> 'Fit | Refusal':
    """The ``medium``, the ``odometry``'s error or the ``time zero``, from what was recorded."""
    from polymap_ros.calibration.fit import calibrated_medium, calibrated_odometry, calibrated_time_zero

    work = {'medium': calibrated_medium, 'odometry': calibrated_odometry, 'time zero': calibrated_time_zero}[what]
    return console.worked(lambda checkpoint: work(session.watched(checkpoint)), f'{name}: calibrating')


def heard_directly(session: 'Session') -> 'Caution':
    """The time zero that the direct wave tells."""
    from polymap_ros.cautions import Caution

    t0_s = session.direct_wave_t0()
    given = session.parameters.echo.t0_s
    return Caution('direct_wave', 'no direct wave stands out of the pings' if t0_s is None else
                   f'by the direct wave, echo.t0_s is {t0_s:.4g} s, not {given:.4g} s; its ringing and its way through '
                   'the device may make that too small')


def told(session: 'Session', result: 'Fit | Refusal') -> 'Caution':
    """What the user has to know about it."""
    from polymap_ros.calibration.diagnosis import fit_in_words, overrides
    from polymap_ros.calibration.stages import Refusal
    from polymap_ros.cautions import Caution

    if isinstance(result, Refusal):
        return Caution('not_calibrated', f'the map is made with what was given, since nothing better was found: '
                                         f'{result.reason}', result.remedy)
    given = ', '.join(f'{session.parameters[name]:g}' for name in result.values)
    return Caution('calibrated', f'the map is made with {fit_in_words(result)} (one standard deviation), not {given}',
                   f'next time: {" ".join(overrides(result))}, or --params-file calibration.yaml')


def pulse_found(session: 'Session', name: str) -> 'FittedPulse | Refusal':
    """The pulse that the echoes fit."""
    from polymap_ros.calibration.pulse_fit import fitted_pulse

    return console.worked(lambda checkpoint: fitted_pulse(session.watched(checkpoint)), f'{name}: pulse')


def pulse_told(session: 'Session', result: 'FittedPulse | Refusal') -> 'Caution':
    """What the user has to know about it."""
    from polymap_ros.calibration.stages import Refusal
    from polymap_ros.cautions import Caution
    from polymap_ros.results.folder import PULSE

    if isinstance(result, Refusal):
        return Caution('not_calibrated', 'the map is made with the pulse that was given, since nothing better was '
                                         f'found: {result.reason}', result.remedy)
    size = f'{1e6 * result.recorded.duration_s:.0f} us at {1e-6 / result.recorded.period_s:g} MHz'
    return Caution('pulse_adapted', f'the map is made with a pulse that was fitted to the echoes, of {size}: with it '
                                    f"{min(result.explained, 1.0):.1%} of the echoes' power is explained",
                   f'from now on: -p pulse.kind:=file -p pulse.path:={PULSE} (of the results)')


def checked(session: 'Session', estimate: 'Estimate', name: str) -> 'list[Caution]':
    """What is wrong with medium or odometry, where the answer leaves reason to ask."""
    from polymap_ros.calibration.diagnosis import diagnosis, doubtful, warning

    if not doubtful(estimate):
        return []
    fit = console.worked(lambda checkpoint: diagnosis(session.watched(checkpoint)),
                         f'{name}: checking medium and odometry')
    return [warning(session, fit)] if fit else []
