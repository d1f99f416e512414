"""Online runs as a table and as a picture."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from polymap_ros.evaluation.figures import new_figure
from polymap_ros.evaluation.online_experiment import OnlineRun
from polymap_ros.evaluation.tables import ALL, markdown, percent, unique


def online_table(runs: Sequence[OnlineRun]) -> str:
    """By method and number of edges.

    Flips: how often, per run, an estimate that was right was no longer so after the next ping. Warm: the solves after
    the first right estimate.
    """
    header = ['method', 'edges', 'runs', 'right at the end', 'pings until right (median)', '90 %', 'flips per run',
              'runs without a flip', 'estimates silently wrong', 'all solves: median [s]', '95 % [s]',
              'warm: median [s]', '95 % [s]']
    rows = []
    for method in unique(run.method for run in runs):
        chosen = [run for run in runs if run.method == method]
        numbers = sorted(unique(run.edges for run in chosen))
        groups = [(str(n), [run for run in chosen if run.edges == n]) for n in numbers]
        if len(groups) > 1:
            groups.append((ALL, chosen))
        rows += [[method, label, *_cells(group)] for label, group in groups]
    return markdown(header, rows)


def unsteady(runs: Sequence[OnlineRun]) -> str:
    """The runs that are not right at the end, or were right and then not, by seed."""
    lines: dict[tuple[str, int], list[str]] = {}
    for run in runs:
        if run.flips or not run.right[-1]:
            text = f'{run.seed} ({run.flips} flips{"" if run.right[-1] else ", not right at the end"})'
            lines.setdefault((run.method, run.edges), []).append(text)
    return '\n'.join(f'- {method}, {edges} edges: {", ".join(texts)}'
                     for (method, edges), texts in sorted(lines.items())) or '- none'


def online_figure(runs: Sequence[OnlineRun], title: str) -> Any:
    """Share of runs that are right, and the time of a solve (median, 5 to 95 %), over the pings heard."""
    figure = new_figure(9.6, 3.6)
    success, times = figure.subplots(1, 2)
    figure.suptitle(title, fontsize='medium')
    for method in unique(run.method for run in runs):
        chosen = [run for run in runs if run.method == method]
        length = min(len(run.right) for run in chosen)
        heard = np.arange(1, length + 1)
        success.plot(heard, 100.0 * np.mean([run.right[:length] for run in chosen], axis=0), label=method)
        low, middle, high = np.quantile([run.seconds[:length] for run in chosen], (0.05, 0.5, 0.95), axis=0)
        times.plot(heard, middle, label=method)
        times.fill_between(heard, low, high, alpha=0.25)
    success.set(xlabel='pings heard', ylabel='right [%]', ylim=(-4.0, 104.0))
    times.set(xlabel='pings heard', ylabel='time of a solve [s]', yscale='log')
    for axes in (success, times):
        axes.grid(alpha=0.3)
    success.legend()
    return figure


def _cells(group: Sequence[OnlineRun]) -> list[str]:
    needed = [np.inf if run.pings_until_right is None else run.pings_until_right for run in group]
    every, warm = [np.concatenate([getattr(run, name) for run in group]) for name in ('seconds', 'warm_seconds')]
    estimates = sum(len(run.right) for run in group)
    return [
        str(len(group)), percent(float(np.mean([run.right[-1] for run in group]))),
        *(_pings(float(np.quantile(needed, share, method='higher'))) for share in (0.5, 0.9)),
        f'{np.mean([run.flips for run in group]):.2f}',
        percent(float(np.mean([run.flips == 0 for run in group]))),
        percent(sum(run.silently_wrong for run in group) / estimates),
        *(f'{np.quantile(seconds, share):.3f}' for seconds in (every, warm) for share in (0.5, 0.95)),
    ]


def _pings(count: float) -> str:
    return f'{count:.0f}' if np.isfinite(count) else 'never'
