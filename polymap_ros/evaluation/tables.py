"""Trials as results.csv and as markdown tables."""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from polymap_ros.evaluation.trials import Trial

T = TypeVar('T')


def csv_text(trials: Sequence[Trial]) -> str:
    """One row per trial under a header; empty cells where there is no value."""
    text = io.StringIO()
    rows = [trial.row() for trial in trials]
    writer = csv.DictWriter(text, list(rows[0]), lineterminator='\n')
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue()


def random_table(trials: Sequence[Trial]) -> str:
    """By method and number of edges: shares of the scenes, medians over scenes, and over walls for the errors.

    The right number of edges and an IoU above 0.95 is what the published method was judged by.
    """
    header = ['method', 'edges', 'scenes', 'right', '95 % interval', 'right number of edges', 'with IoU > 0.95',
              'no polygon', 'median IoU', 'median offset error [mm]', 'median angle error [deg]', 'median time [s]']
    rows = []
    for method in unique(trial.method for trial in trials):
        of_method = [trial for trial in trials if trial.method == method]
        edges = unique(trial.edges for trial in of_method)
        groups = [(str(n), [trial for trial in of_method if trial.edges == n]) for n in sorted(edges)]
        if len(groups) > 1:
            groups.append(('all', of_method))
        rows += [[method, label, *_summary(group)] for label, group in groups]
    return markdown(header, rows)


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
    """The scenes that were not right, by seed, for every method and number of edges."""
    lines = []
    for method in unique(trial.method for trial in trials):
        for edges in sorted(unique(trial.edges for trial in trials)):
            seeds = [str(trial.seed) for trial in trials
                     if trial.method == method and trial.edges == edges and not trial.right]
            if seeds:
                lines.append(f'- {method}, {edges} edges: {", ".join(seeds)}')
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


def percent(share: float) -> str:
    """A share for a table."""
    return f'{100.0 * share:.1f} %'


def _summary(group: Sequence[Trial]) -> list[str]:
    right = sum(trial.right for trial in group)
    low, high = wilson(right, len(group))
    return [
        str(len(group)), percent(right / len(group)), f'{100.0 * low:.0f} to {100.0 * high:.0f} %',
        percent(np.mean([trial.estimated_edges == trial.edges for trial in group]).item()),
        percent(np.mean([trial.estimated_edges == trial.edges and trial.iou > 0.95 for trial in group]).item()),
        percent(np.mean([trial.status != 'closed' for trial in group]).item()),
        f'{np.median([trial.iou for trial in group]):.4f}',
        _median([offset for trial in group for offset in trial.offsets_m], 1e3),
        _median([angle for trial in group for angle in trial.angles_deg], 1.0),
        f'{np.median([trial.seconds for trial in group]):.2f}',
    ]


def _median(values: Sequence[float], scale: float) -> str:
    return f'{scale * float(np.median(values)):.3f}' if values else '-'


def _cell(value: object) -> object:
    if value is None:
        return ''
    if isinstance(value, bool):
        return int(value)
    return f'{value:.9g}' if isinstance(value, float) else value


def unique(values: Iterable[T]) -> list[T]:
    """Distinct values in the order of their first appearance."""
    return list(dict.fromkeys(values))
