"""Trials as markdown tables."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from polymap_ros.evaluation.trials import Trial

T = TypeVar('T')

ALL = 'all'


def random_table(trials: Sequence[Trial]) -> str:
    """By method, SNR and number of edges: shares of the scenes, and the median time of a solve from scratch.

    The right number of edges with an IoU above 0.95 is what the published method was judged by. Flagged is an answer
    that is not a closed polygon or comes with a caution; silently wrong is one that is neither right nor flagged.
    """
    header = ['method', 'SNR [dB]', 'edges', 'scenes', 'right', '95 % interval', 'right number of edges',
              'with IoU > 0.95', 'no polygon', 'flagged', 'silently wrong', 'median time [s]']
    return markdown(header, [[*label, *_success(group)] for label, group in _groups(trials)])


def accuracy_table(trials: Sequence[Trial]) -> str:
    """By method, SNR and number of edges: medians over the walls of the right scenes, and over all walls found.

    Within 2 sigma: share of the walls of right scenes whose true r, theta, length or corner angle, and of the scenes
    whose area, is within two of the estimate's standard deviations. Certain: edges reported with a likelihood of at
    least 0.9, in all scenes; real: of these, the share that is a true wall.
    """
    header = ['method', 'SNR [dB]', 'edges', 'median IoU', 'offset error, right scenes [mm]', 'angle error [deg]',
              'offset error, all [mm]', 'angle error [deg]',
              *(f'{name} within 2 sigma' for name in ('r', 'theta', 'length', 'corner', 'area')), 'certain', 'real']
    return markdown(header, [[*label, *_accuracy(group)] for label, group in _groups(trials)])


def paper_table(trials: Sequence[Trial]) -> str:
    """By scene and method: shares of the repetitions, final IoU, time of one solve."""
    header = ['scene', 'method', 'repetitions', 'right number of edges', 'right', 'median IoU', 'lowest IoU',
              'median time [s]']
    rows = []
    for scene, method in unique((trial.scene, trial.method) for trial in trials):
        group = [trial for trial in trials if (trial.scene, trial.method) == (scene, method)]
        overlaps = [trial.iou for trial in group]
        rows.append([
            scene, method, str(len(group)),
            percent(np.mean([trial.estimated_edges == trial.edges for trial in group]).item()),
            percent(np.mean([trial.right for trial in group]).item()),
            f'{np.median(overlaps):.4f}', f'{min(overlaps):.4f}',
            f'{np.median([trial.seconds for trial in group]):.2f}'])
    return markdown(header, rows)


def failures(trials: Sequence[Trial]) -> str:
    """The scenes that were not right, by seed, for every method, SNR and number of edges; flagged ones with a star."""
    lines = []
    for (method, noise, edges), group in _groups(trials):
        seeds = [f'{trial.seed}{"*" if trial.flagged else ""}' for trial in group if not trial.right]
        if seeds and edges != ALL:
            lines.append(f'- {method}, {noise} dB, {edges} edges: {", ".join(seeds)}')
    return '\n'.join(lines) or '- none'


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table, without a line break at the end."""
    lines = [header, ['---'] * len(header), *rows]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


def wilson(successes: int, of: int) -> tuple[float, float]:
    """95 % confidence interval of a share (Wilson 1927)."""
    z = 1.959964
    centre = (successes + z * z / 2.0) / (of + z * z)
    half = z / (of + z * z) * float(np.sqrt(successes * (of - successes) / of + z * z / 4.0))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def interval(successes: int, of: int) -> str:
    """The 95 % interval of a share, for a table."""
    low, high = wilson(successes, of)
    return f'{100.0 * low:.0f} to {100.0 * high:.0f} %'


def percent(share: float) -> str:
    """A share for a table."""
    return f'{100.0 * share:.1f} %'


def _groups(trials: Sequence[Trial]) -> list[tuple[tuple[str, str, str], list[Trial]]]:
    """Trials by method, SNR and number of edges, and of all numbers of edges together where there are several."""
    groups = []
    for method, snr_db in unique((trial.method, trial.snr_db) for trial in trials):
        chosen = [trial for trial in trials if (trial.method, trial.snr_db) == (method, snr_db)]
        label = method, decibels(snr_db)
        numbers = sorted(unique(trial.edges for trial in chosen))
        groups += [((*label, str(n)), [trial for trial in chosen if trial.edges == n]) for n in numbers]
        if len(numbers) > 1:
            groups.append(((*label, ALL), chosen))
    return groups


def decibels(snr_db: float | None) -> str:
    """An SNR for a table."""
    return 'inf' if snr_db is None else f'{snr_db:g}'


def _success(group: Sequence[Trial]) -> list[str]:
    right = sum(trial.right for trial in group)
    return [
        str(len(group)), percent(right / len(group)), interval(right, len(group)),
        _share([trial.estimated_edges == trial.edges for trial in group]),
        _share([trial.estimated_edges == trial.edges and trial.iou > 0.95 for trial in group]),
        _share([trial.status != 'closed' for trial in group]),
        _share([trial.flagged for trial in group]),
        _share([not trial.right and not trial.flagged for trial in group]),
        f'{np.median([trial.seconds for trial in group]):.2f}',
    ]


def _accuracy(group: Sequence[Trial]) -> list[str]:
    right = [trial for trial in group if trial.right]
    certain = sum(trial.certain_edges for trial in group)
    return [
        f'{np.median([trial.iou for trial in group]):.4f}',
        *(_median([offset for trial in chosen for offset in trial.offsets_m], 1e3)
          if quantity == 'offset' else _median([angle for trial in chosen for angle in trial.angles_deg], 1.0)
          for chosen in (right, group) for quantity in ('offset', 'angle')),
        *(_share([abs(score) <= 2.0 for trial in right for score in getattr(trial, name)])
          for name in ('z_r', 'z_theta', 'z_length', 'z_angle', 'z_area')),
        str(certain),
        percent(sum(trial.certain_real for trial in group) / certain) if certain else '-',
    ]


def _share(values: Sequence[bool]) -> str:
    return percent(float(np.mean(values))) if values else '-'


def _median(values: Sequence[float], scale: float) -> str:
    return f'{scale * float(np.median(values)):.3f}' if values else '-'


def unique(values: Iterable[T]) -> list[T]:
    """Distinct values in the order of their first appearance."""
    return list(dict.fromkeys(values))
