"""When an answer does not explain the echoes: is it the medium, or the odometry?"""

from polymap_ros.calibration.fit import calibrated_medium, calibrated_odometry, needed
from polymap_ros.calibration.session import Session
from polymap_ros.calibration.stages import Fit
from polymap_ros.cautions import Caution, of_faulty_samples
from polymap_ros.solvers.estimate import Estimate

SYMPTOMS = {'unexplained', 'incoherent', 'not_closed', 'weak_edge'}
"""Cautions that a wrong medium or a drifting odometry may be behind: where the echoes agree in phase along the whole
path, as reported or from poses that are estimated, there is nothing to look for."""

_SIGNIFICANT = 5.0
"""Deviations by which a parameter that is called wrong differs at least from what was given."""

_SCALE = 0.002
"""Relative error of a scale that is worth a word."""

_TEXTS = {
    'medium': ('wrong_medium', 'the echoes do not fit the medium that was given, but {found} (one standard deviation)',
               'replay with --calibrate, or {next}'),
    'odometry': ('wrong_odometry', 'the echoes do not fit the odometry as it is, but with {found} (one standard '
                                   'deviation)', 'replay with --fit-odometry, or {next}'),
}


def doubtful(estimate: Estimate) -> bool:
    """Whether there is reason to look for a wrong medium or odometry."""
    codes = {caution.code for caution in estimate.cautions}
    blamed = 'straight_path' in codes or of_faulty_samples(estimate.cautions)
    return estimate.method == 'evidence' and bool(codes & SYMPTOMS) and not blamed


def diagnosis(session: Session) -> Fit | None:
    """What is wrong with medium or odometry; None where neither explains the echoes, or both are as given.

    A single number of the medium that does is believed. Else the odometry is tried, too, and what explains the echoes
    with fewer numbers changed is taken. A plate whose thickness and speeds are all scaled alike sounds exactly as if
    the odometry's scale were wrong; that is called the odometry's.
    """
    medium = calibrated_medium(session, elsewhere=True)
    fits = [medium] if isinstance(medium, Fit) else []
    if not fits or len(fits[0].values) > 1:
        odometry = calibrated_odometry(session, elsewhere=True)
        fits += [odometry] if isinstance(odometry, Fit) else []
    # Odometry first where as many numbers change: drift and scale are the commoner faults.
    fits = sorted((fit for fit in fits[::-1] if _changed(session, fit)), key=lambda fit: _changed(session, fit))
    best = fits[0] if fits else None
    for fit in fits[1:]:
        best = fit if fit.value > fits[0].value + needed(fits[0].value) else best
    return best


def _changed(session: Session, fit: Fit) -> int:
    """Number of parameters that differ from what was given."""
    return sum(abs(value - float(session.parameters[name])) > _SIGNIFICANT * fit.deviations[name]
               for name, value in fit.values.items())


def warning(session: Session, fit: Fit) -> Caution:
    """What the user has to know of a diagnosis."""
    code, finding, remedy = _TEXTS[next(iter(fit.values)).partition('.')[0]]
    finding = finding.format(found=fit_in_words(fit))
    given = session.parameters
    if 'medium.speed_m_s' in fit.values:
        scale = given.odometry.scale * fit.values['medium.speed_m_s'] / given.medium.speed_m_s
        finding += (f' (with the given speed an odometry.scale of {scale:.5g} sounds the same: echoes tell only the '
                    'ratio)')
    if 'odometry.scale' in fit.values and abs(fit.values['odometry.scale'] / given.odometry.scale - 1.0) > _SCALE:
        finding += ' (a medium with thickness and speeds scaled by as much sounds the same: echoes tell only the ratio)'
    return Caution(code, finding, remedy.format(next=' '.join(overrides(fit))))


def fit_in_words(fit: Fit) -> str:
    """What was found, with one standard deviation each."""
    return ' and '.join(f'{name} {value:.6g} +- {fit.deviations[name]:.2g}' for name, value in fit.values.items())


def overrides(fit: Fit) -> list[str]:
    """What to say next time."""
    return [f'-p {name}:={value:.6g}' for name, value in fit.values.items()]
