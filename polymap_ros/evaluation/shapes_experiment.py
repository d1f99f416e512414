"""Outlines that are not convex, and plates with holes or inner walls: how many are right, and what it takes."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from polymap_ros.evaluation.slam_experiment import aligning, with_faults
from polymap_ros.evaluation.tables import interval, markdown, percent, unique
from polymap_ros.evaluation.trials import TOLERANCE_M, KindTrial, filled_mapper, inside_judged, judged, ready
from polymap_ros.evaluation.variants import mild
from polymap_ros.geometry.inside_error import InsideComparison
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.shaped_scenes import SHAPE_KINDS, clean_echoes, shaped_scene

WORLDS: dict[str, Callable[[Scene], Scene]] = {
    'clean': lambda scene: scene,
    'mild': mild,
    'typical': partial(with_faults, drift='typical'),
}
"""By name, what else the world is like: as in the variant `mild` of `random`, or with odometry that drifts."""


@dataclass(frozen=True)
class ShapeTrial(KindTrial):
    """A trial of a kind of `SHAPE_KINDS`: whether the outline alone is right, and what was found inside."""

    outline_right: bool
    inside: InsideComparison

    def row(self) -> dict[str, object]:
        """The row of results.csv."""
        counts = dataclasses.asdict(self.inside)
        ends_m = counts.pop('ends_m')
        return {**super().row(), 'outline_right': self.outline_right, **counts,
                'median_end_m': float(np.median(ends_m)) if ends_m else None}


@dataclass(frozen=True)
class ShapesExperiment:
    """Every kind with every seed.

    Parameters
    ----------
    kinds : sequence of str
        Of `SHAPE_KINDS`.
    seeds : sequence of int
        As many scenes per kind as seeds.
    snr_db : float or None
        As in `Scene`.
    parameters : Parameters
        What the scene does not prescribe.
    echoes : str
        Of `ECHOES`.
    world : str
        Of `WORLDS`; but for `clean` the echoes are those of `noise_free`.
    """

    kinds: Sequence[str]
    seeds: Sequence[int]
    snr_db: float | None
    parameters: Parameters
    echoes: str = 'images'
    world: str = 'clean'

    def scenes(self) -> list[tuple[str, int]]:
        """Kind and seed of every scene."""
        return [(kind, seed) for kind in self.kinds for seed in self.seeds]

    def run_one(self, kind: str, seed: int) -> list[ShapeTrial]:
        """The trial of one scene, whose `seconds` are of CPU."""
        scene = WORLDS[self.world](dataclasses.replace(shaped_scene(kind, seed), snr_db=self.snr_db))
        ready(self.parameters)
        clean = clean_echoes(scene, self.echoes) if self.world == 'clean' else None
        mapper = filled_mapper(scene, self.parameters, clean)
        started = time.process_time()
        estimate = mapper.solve()
        seconds = time.process_time() - started
        if scene.faults.drift != 'none':
            estimate = estimate.moved(aligning(estimate, scene).motion)
        trial = judged(estimate, scene, self.parameters.solver.method, seconds)
        polygon = estimate.polygon
        right = polygon is not None and compare(polygon.vertices, scene.vertices, TOLERANCE_M).right
        return [ShapeTrial(kind, trial, right, inside_judged(estimate, scene))]


def shapes_text(trials: Sequence[ShapeTrial]) -> str:
    """The table of outlines that are not convex, and that of plates with something inside, as far as there are any."""
    inside = [entry for entry in trials if SHAPE_KINDS[entry.kind].inside]
    outlines = [entry for entry in trials if not SHAPE_KINDS[entry.kind].inside]
    tables = (outlines and shapes_table(outlines), inside and inside_table(inside))
    return '\n\n'.join(table for table in tables if table)


def shapes_table(trials: Sequence[KindTrial]) -> str:
    """By kind and for all: right with its 95 % interval (Wilson 1927), what is told, errors of right ones, CPU time."""
    header = ['outline', 'right', '95 % interval', 'silently wrong', 'open', 'right, yet flagged',
              'offset error, median [mm]', 'r, theta within 2 sigma', 'CPU [s] median / worst', 'median of those open']
    groups = [(SHAPE_KINDS[kind].text, [entry.trial for entry in trials if entry.kind == kind])
              for kind in unique(entry.kind for entry in trials)]
    rows = []
    for text, group in (*groups, ('all', [entry.trial for entry in trials])):
        right = [trial for trial in group if trial.right]
        is_open = [trial.seconds for trial in group if trial.status != 'closed']
        offsets = [offset for trial in right for offset in trial.offsets_m]
        within = [percent(np.mean(np.abs(z) <= 2.0).item()) if z else '-' for z in (
            [score for trial in right for score in trial.z_r], [score for trial in right for score in trial.z_theta])]
        seconds = [trial.seconds for trial in group]
        rows.append([
            text, f'{len(right)} of {len(group)}', interval(len(right), len(group)),
            str(sum(not trial.flagged and not trial.right for trial in group)), str(len(is_open)),
            str(sum(trial.flagged for trial in right)), f'{1e3 * np.median(offsets):.3f}' if offsets else '-',
            ', '.join(within), f'{np.median(seconds):.1f} / {max(seconds):.1f}',
            f'{np.median(is_open):.1f}' if is_open else '-'])
    return markdown(header, rows)


def inside_table(trials: Sequence[ShapeTrial]) -> str:
    """By kind and for all: right outlines, holes and inner walls with 95 % intervals, what is told, and CPU time."""
    header = ['plate', 'outline right', 'holes right', 'inner walls right', 'all right', 'silently wrong', 'open',
              'right, yet flagged', 'ends of inner walls, median error [mm]', 'CPU [s] median / worst']
    groups = [(SHAPE_KINDS[kind].text, [entry for entry in trials if entry.kind == kind])
              for kind in unique(entry.kind for entry in trials)]
    rows = []
    for text, group in (*groups, ('all', list(trials))):
        outlines, right = sum(entry.outline_right for entry in group), [entry for entry in group if entry.trial.right]
        holes = sum(entry.inside.right_holes for entry in group), sum(entry.inside.n_true_holes for entry in group)
        walls = (sum(entry.inside.right_inner_walls for entry in group),
                 sum(entry.inside.n_true_inner_walls for entry in group))
        ends = [end for entry in group for end in entry.inside.ends_m]
        seconds = [entry.trial.seconds for entry in group]
        rows.append([
            text, *(f'{found} of {of} ({interval(found, of)})' if of else '-'
                    for found, of in ((outlines, len(group)), holes, walls)), f'{len(right)} of {len(group)}',
            str(sum(not entry.trial.flagged and not entry.trial.right for entry in group)),
            str(sum(entry.trial.status != 'closed' for entry in group)),
            str(sum(entry.trial.flagged for entry in right)), f'{1e3 * np.median(ends):.1f}' if ends else '-',
            f'{np.median(seconds):.1f} / {max(seconds):.1f}'])
    return markdown(header, rows)


def shape_failures(trials: Sequence[KindTrial]) -> str:
    """The scenes that are not right, or flagged, with their status and cautions."""
    lines = [f'- {entry.trial.scene}: {", ".join((entry.trial.status, *entry.trial.cautions))}'
             f'{"" if entry.trial.right else " (not right)"}'
             for entry in trials if not entry.trial.right or entry.trial.flagged]
    return '\n'.join(lines) or '- none'
