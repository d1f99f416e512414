"""When an answer does not explain the echoes: is it the medium, or the odometry?"""

from collections.abc import Generator

from polymap_ros.mapping.calibration import Fit, calibrated_medium, calibrated_odometry
from polymap_ros.mapping.estimate import Caution, Estimate
from polymap_ros.mapping.session import Session

SYMPTOMS = {'unexplained', 'incoherent', 'not_closed', 'weak_edge'}
"""Cautions that a wrong medium or a drifting odometry may be behind: where the echoes agree in phase along the whole
path, both are right to a part in a thousand, and there is nothing to look for."""

_PARAMETER = 17.0
"""Nats that one more parameter has to bring."""

_TEXTS = {
    'medium': ('wrong_medium', 'the echoes do not fit the medium given, but {found} (one standard deviation); replay '
                               'with --calibrate, or {next}'),
    'odometry': ('wrong_odometry', 'the echoes do not fit the odometry as it is, but with {found} (one standard '
                                   'deviation); replay with --fit-odometry, or {next}'),
}


def doubtful(estimate: Estimate) -> bool:
    """Whether there is reason to look for a wrong medium or odometry."""
    codes = {caution.code for caution in estimate.cautions}
    return estimate.method == 'evidence' and bool(codes & SYMPTOMS) and 'straight_path' not in codes


def diagnosis(session: Session) -> Generator[None, None, list[Caution]]:
    """What is wrong with medium or odometry, with an estimate; nothing where neither explains the echoes.

    A single number of the medium that does is believed. Else what explains the echoes better is named: with two numbers
    of the medium, a wrong scale of the odometry is explained, too, though not as well.
    """
    medium = yield from calibrated_medium(session, elsewhere=True)
    fits = [medium] if isinstance(medium, Fit) else []
    if not fits or len(fits[0].values) > 1:
        odometry = yield from calibrated_odometry(session, elsewhere=True)
        fits += [odometry] if isinstance(odometry, Fit) else []
    if not fits:
        return []
    best = max(fits, key=lambda fit: fit.value - _PARAMETER * len(fit.values))
    code, text = _TEXTS[next(iter(best.values)).partition('.')[0]]
    text = text.format(found=in_words(best), next=' '.join(overrides(best)))
    if 'medium.speed_m_s' in best.values:
        given = session.parameters
        scale = given.odometry.scale * best.values['medium.speed_m_s'] / given.medium.speed_m_s
        text += f'. With the speed given, an odometry.scale of {scale:.5g} sounds the same: echoes tell only the ratio'
    return [Caution(code, text)]


def in_words(fit: Fit) -> str:
    """What was found, with one standard deviation each."""
    return ' and '.join(f'{name} {value:.6g} +- {fit.deviations[name]:.2g}' for name, value in fit.values.items())


def overrides(fit: Fit) -> list[str]:
    """What to say next time."""
    return [f'-p {name}:={value:.6g}' for name, value in fit.values.items()]
