"""Echoes of higher orders that are stronger or weaker than walls of one coefficient each make them, or not there."""

from dataclasses import replace

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, EXPLAINED, FULL_ORDER, ORDERS_WORTH
from polymap_ros.solvers.evidence.waveform import Wave


def weigh_orders(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with each order as strong as fits it, where the walls explain the echoes then only."""
    wave = standing.wave
    if standing.explained < EXPLAINED - ground.uncertainty or ground.as_modelled(wave) > ALL_EXPLAINED:
        return None
    ground.checkpoint()
    strengths, _ = ground.wave.by_order(wave, FULL_ORDER)
    loudness = wave.loudness._replace(strengths=strengths)
    weighed = ground.wave.refine(replace(wave, loudness=loudness, slopes=None), FULL_ORDER)
    return weighed if weighed is not None and weighed.value > ORDERS_WORTH * wave.value else None
