"""The experiments as pictures."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from polymap_ros.evaluation.paper_experiment import History
from polymap_ros.evaluation.tables import unique, wilson
from polymap_ros.evaluation.trials import Trial

_MARKS = 'osD^vP'


def success_figure(trials: Sequence[Trial], title: str) -> Any:
    """Share of right scenes over the number of edges, one line per method, with 95 % intervals.

    Where there are several SNRs, the same over the SNR, all numbers of edges together, is drawn beside it; the first
    picture is then at the highest SNR.
    """
    levels = sorted(unique(trial.snr_db for trial in trials if trial.snr_db is not None), reverse=True)
    several = len(levels) > 1
    figure = new_figure(9.6 if several else 5.6, 3.6)
    axes = figure.subplots(1, 2 if several else 1, sharey=True, squeeze=False)[0]
    figure.suptitle(title, fontsize='medium')
    at_one = [trial for trial in trials if trial.snr_db == levels[0]] if several else trials
    _success_over(axes[0], at_one, lambda trial: float(trial.edges), 'edges', shift=0.08)
    axes[0].set(ylabel='right [%]', ylim=(-4.0, 104.0), xticks=sorted(unique(trial.edges for trial in trials)))
    if several:
        axes[0].set_title(f'at {levels[0]:g} dB', fontsize='small')
        noisy = [trial for trial in trials if trial.snr_db is not None]
        _success_over(axes[1], noisy, lambda trial: float(trial.snr_db or 0.0), 'SNR per ping [dB]', shift=0.2)
        axes[1].set_title('all numbers of edges', fontsize='small')
        axes[1].set_xticks(levels)
    axes[0].legend()
    return figure


def _success_over(
    axes: Any, trials: Sequence[Trial], at: Callable[[Trial], float], label: str, shift: float
) -> None:
    methods = unique(trial.method for trial in trials)
    for index, method in enumerate(methods):
        chosen = [trial for trial in trials if trial.method == method]
        places = sorted(unique(at(trial) for trial in chosen))
        groups = [[trial.right for trial in chosen if at(trial) == place] for place in places]
        shares = np.array([np.mean(group) for group in groups])
        bounds = np.array([wilson(sum(group), len(group)) for group in groups])
        spread = np.abs(bounds.T - shares)
        aside = shift * (index - (len(methods) - 1) / 2.0)
        axes.errorbar(np.array(places) + aside, 100.0 * shares, 100.0 * spread, marker=_MARKS[index % len(_MARKS)],
                      capsize=3.0, label=method)
    axes.set_xlabel(label)
    axes.grid(alpha=0.3)


def convergence_figure(histories: Mapping[str, Sequence[History]], baselines: Mapping[str, float]) -> Any:
    """Cost, number of edges after the filter, and IoU with the truth over the iterations (Fig. 3 and Fig. 4b).

    Parameters
    ----------
    histories : mapping from scene to histories
        One column per scene; repetitions in blue, their median in red.
    baselines : mapping from scene to float
        IoU of the baseline, drawn as a black line.
    """
    figure = new_figure(0.8 + 3.2 * len(histories), 6.0)
    grid = figure.subplots(3, len(histories), sharex=True, squeeze=False)
    for column, (name, runs) in zip(grid.T, histories.items(), strict=True):
        for axes, quantity in zip(column, ('cost', 'edges', 'iou'), strict=True):
            values = np.array([getattr(run, quantity) for run in runs], dtype=float)
            iterations = np.arange(1, values.shape[1] + 1)
            axes.plot(iterations, values.T, color='tab:blue', linewidth=0.7, alpha=0.6)
            axes.plot(iterations, np.median(values, axis=0), color='tab:red', linewidth=1.6)
            axes.grid(alpha=0.3)
        if name in baselines:
            column[2].axhline(baselines[name], color='black', linewidth=1.0)
        true_edges = runs[0].true_edges
        column[0].set_title(f'{name} ({true_edges} edges)')
        column[1].set_yticks(range(0, 11, 2))
        column[1].axhline(true_edges, color='gray', linewidth=0.8, linestyle=':')
        column[2].set(ylim=(-0.03, 1.03), xlabel='iteration')
    for axes, label in zip(grid[:, 0], ('cost, eq. (5)', 'edges after eq. (10)', 'IoU with the truth'), strict=True):
        axes.set_ylabel(label)
    return figure


def new_figure(width_in: float, height_in: float) -> Any:
    """An empty figure of this size; no window, no global state."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout='constrained')
