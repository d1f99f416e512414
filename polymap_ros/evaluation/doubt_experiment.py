"""Never silently wrong: which of the scenes that no convex polygon explains are flagged, and which ordinary ones."""

import dataclasses
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from polymap_ros.evaluation.tables import markdown, percent, unique
from polymap_ros.evaluation.trials import KindTrial, run_trials
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.doubtful_scenes import KINDS, ORDINARY


@dataclass(frozen=True)
class DoubtExperiment:
    """Every kind with every seed; the number of edges goes round with the seeds.

    Parameters
    ----------
    kinds : sequence of str
        Of `KINDS`.
    seeds, edges : sequences of int
        As many scenes per kind as seeds. Outlines that are not convex have a number of edges of their own.
    methods : sequence of str
        Values of ``solver.method``.
    snr_db : float or None
        As in `Scene`.
    parameters : Parameters
        What the scene does not prescribe.
    """

    kinds: Sequence[str]
    seeds: Sequence[int]
    edges: Sequence[int]
    methods: Sequence[str]
    snr_db: float | None
    parameters: Parameters

    def scenes(self) -> list[tuple[str, int, int]]:
        """Kind, seed and number of edges of every scene."""
        return [(kind, seed, self.edges[index % len(self.edges)])
                for kind in self.kinds for index, seed in enumerate(self.seeds)]

    def run_one(self, kind: str, seed: int, edges: int) -> list[KindTrial]:
        """The trials of one scene."""
        made = KINDS[kind].make(seed, edges)
        scene = dataclasses.replace(made.scene, name=f'{kind}-{edges}-{seed}', snr_db=self.snr_db)
        return [KindTrial(kind, trial) for trial in run_trials(scene, self.methods, self.parameters, clean=made.clean)]


def doubt_table(trials: Sequence[KindTrial]) -> str:
    """By method and kind: shares of the scenes flagged, and not flagged though right or wrong; cautions given."""
    header = ['method', 'kind', 'scenes', 'to be flagged', 'flagged', 'not flagged, right', 'not flagged, wrong',
              'status', 'cautions']
    rows = []
    for method, kind in unique((entry.trial.method, entry.kind) for entry in trials):
        group = [entry.trial for entry in trials if (entry.trial.method, entry.kind) == (method, kind)]
        silent = [trial for trial in group if not trial.flagged]
        right = sum(trial.right for trial in silent)
        rows.append([
            method, KINDS[kind].text, str(len(group)), 'yes' if KINDS[kind].must_be_flagged else 'no',
            *(percent(count / len(group)) for count in (len(group) - len(silent), right, len(silent) - right)),
            _counted(trial.status for trial in group), _counted(code for trial in group for code in trial.cautions)])
    return markdown(header, rows)


def faults(trials: Sequence[KindTrial]) -> str:
    """The scenes that should be flagged and are not, or the other way round, as edges-seed."""
    names: dict[tuple[str, str], list[str]] = {}
    for entry in trials:
        if _faulty(entry):
            label = entry.trial.scene.removeprefix(f'{entry.kind}-')
            names.setdefault((entry.trial.method, entry.kind), []).append(label)
    return '\n'.join(f'- {method}, {kind}: {", ".join(labels)}' for (method, kind), labels in names.items()) or '- none'


def _faulty(entry: KindTrial) -> bool:
    if entry.trial.flagged:
        return entry.kind == ORDINARY
    return KINDS[entry.kind].must_be_flagged or not entry.trial.right


def _counted(names: Iterable[str]) -> str:
    counts = Counter(names)
    return ', '.join(f'{name} {count}' for name, count in counts.most_common()) or '-'
