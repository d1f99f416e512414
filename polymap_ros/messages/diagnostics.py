"""The state of a mapping node in words and figures, as diagnostic_msgs/msg/DiagnosticArray."""

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from polymap_ros.cautions import causes
from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.plane import XY
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.markers import answer_line
from polymap_ros.messages.outputs import Make, coarse_polygon, header

OK, WARN, ERROR = 0, 1, 2

SILENCE_S = 5.0
"""After this time without a message on an input, the reason is looked for and told."""

HOLD_S = 5.0
"""What happened within this time is still told, so that rare events do not make the state flicker."""


@dataclass(frozen=True)
class InputFigures:
    """What one input topic has brought so far.

    Parameters
    ----------
    topic : str
        Its full name.
    received, refused, lost, incompatible : int
        Messages that came, those of them that were no use, messages the middleware lost, publishers that offer a QoS
        the node cannot take.
    refusal : str
        Why the last message that was no use was refused.
    silence : str
        Why nothing comes; empty while messages come.
    """

    topic: str
    received: int
    refused: int = 0
    lost: int = 0
    incompatible: int = 0
    refusal: str = ''
    silence: str = ''


@dataclass(frozen=True)
class Figures:
    """What is looked at, at one moment.

    Parameters
    ----------
    odometry, echoes : InputFigures
        The two inputs.
    mapper : PolygonMapper
        Holds the counts of pings and the last answer.
    paused : bool
        Nothing is mapped.
    behind : int
        Solves that were due while one was still running.
    pace : str
        How long such a solve takes.
    problems : sequence of str
        What failed: a solve, a save; empty where nothing did.
    timings : mapping of str to str
        Further figures to be shown.
    starting : str
        What the start does, and for how long; empty when it is over.
    crowds : tuple of str
        Inputs on which several publish, in words.
    """

    odometry: InputFigures
    echoes: InputFigures
    mapper: PolygonMapper
    paused: bool = False
    behind: int = 0
    pace: str = ''
    problems: tuple[str, ...] = ()
    timings: Mapping[str, str] = field(default_factory=dict)
    starting: str = ''
    crowds: tuple[str, ...] = ()


class State(NamedTuple):
    """The worst level, its sentences, all findings with their levels, and the figures."""

    level: int
    sentence: str
    findings: list[tuple[int, str]]
    values: dict[str, str]


class Watch:
    """Tells the state from one look to the next.

    Parameters
    ----------
    now_s : float
        When it begins, on the clock of the looks [s].
    """

    def __init__(self, now_s: float) -> None:
        self._then_s = now_s
        self._before = Counter[str]()
        self._recent = deque[tuple[float, Counter[str]]]()

    def begin_anew(self, figures: Figures) -> None:
        """Forget what happened before: the map is reset, and what it counted with it."""
        self._before = _counts(figures)
        self._recent.clear()

    def look(self, now_s: float, figures: Figures) -> State:
        """Return the state now [s]."""
        counts = _counts(figures)
        new = counts - self._before
        elapsed_s = max(now_s - self._then_s, 1e-6)
        rates = {name: new[name] / elapsed_s for name in ('odometry', 'echoes')}
        self._then_s, self._before = now_s, counts
        self._recent.append((now_s, new))
        while self._recent[0][0] <= now_s - HOLD_S:
            self._recent.popleft()
        findings = list(_findings(figures, sum((each for _, each in self._recent), Counter[str]())))
        level = max((level for level, _ in findings), default=OK)
        reasons = (text for found, text in findings if found == level)
        sentence = '; '.join(filter(None, (figures.starting, *reasons)))
        return State(level, sentence, findings, _values(figures, rates))


def diagnostic_message(make: Make, stamp_ns: int, node_name: str, state: State) -> Any:
    """diagnostic_msgs/msg/DiagnosticArray of the state of a node."""
    return make('diagnostic_msgs/msg/DiagnosticArray', header=header(make, stamp_ns, ''), status=[make(
        'diagnostic_msgs/msg/DiagnosticStatus', level=state.level, name=f'{node_name}: polygon mapping',
        message=state.sentence, hardware_id='',
        values=[make('diagnostic_msgs/msg/KeyValue', key=key, value=value) for key, value in state.values.items()],
    )])


def _counts(figures: Figures) -> Counter[str]:
    counts = Counter({f'dropped {reason}': n for reason, n in figures.mapper.counts.dropped.items()})
    counts.update({
        'odometry': figures.odometry.received, 'echoes': figures.echoes.received, 'used': figures.mapper.counts.used,
        'behind': figures.behind, 'odometry refused': figures.odometry.refused,
        'odometry lost': figures.odometry.lost, 'echoes lost': figures.echoes.lost,
    })
    return counts


def _findings(figures: Figures, new: Counter[str]) -> Iterator[tuple[int, str]]:
    """State and reason, most basic first; `new` holds what was counted in the last `HOLD_S`."""
    if figures.paused:
        yield OK, 'paused'
        return
    odometry, echoes, mapper = figures.odometry, figures.echoes, figures.mapper
    yield from ((ERROR, crowd) for crowd in figures.crowds)
    for each in (odometry, echoes):
        if each.silence:
            yield (ERROR if each.silence.startswith(('wrong type', 'incompatible')) else WARN), each.silence
    for each, name in ((odometry, 'odometry lost'), (echoes, 'echoes lost')):
        if new[name]:
            yield WARN, (f'messages lost on {each.topic}: {new[name]} in the last {HOLD_S:g} s; is the machine '
                         f'too busy, or qos_overrides.{each.topic}.subscription.depth too small?')
    if new['odometry'] and new['odometry refused'] >= new['odometry']:
        yield ERROR, f'odometry is refused: {odometry.refusal}'
    yield from _drops(mapper.intake.last_drop_texts, new)
    if figures.starting:
        return
    counts, missing = mapper.counts, mapper.intake.missing_frame
    if counts.waiting and missing:
        yield WARN, f'{counts.waiting} pings wait for TF to connect their frame {missing!r} to the odometry\'s ' \
                    'child_frame_id (sensor.from_tf)'
    elif counts.waiting and new['echoes'] and not new['used'] and not odometry.silence:
        yield WARN, f'{counts.waiting} pings wait for odometry: is it late, or are the clocks of the two apart?'
    if new['behind']:
        yield WARN, f'the solver is behind: {figures.pace}'
    for problem in filter(None, figures.problems):
        yield ERROR, problem
    estimate = mapper.estimate
    known = estimate.cautions if estimate is not None else ()
    first_of_all = causes(known) if estimate is not None and estimate.status != 'closed' else []
    if estimate is not None and estimate.status != 'closed':
        yield WARN, f'no polygon: {"; ".join(each.text for each in first_of_all) or estimate.status}'
    yield from ((WARN, caution.text) for caution in known if caution not in first_of_all)
    if estimate is not None and estimate.polygon is not None:
        coarse = coarse_polygon(estimate.polygon, mapper.plane or XY)
        yield from ((WARN, caution.text) for caution in (coarse,) if caution)
    first = estimate is None and counts.used > 0
    yield OK, f'{counts.used} pings; the first solve is to come' if first else answer_line(estimate)


def _drops(texts: Mapping[str, str], new: Counter[str]) -> Iterator[tuple[int, str]]:
    for name, count in new.items():
        kind, _, reason = name.partition(' ')
        if kind == 'dropped' and count > 0 and reason != 'paused':
            level = WARN if new['used'] else ERROR
            yield level, f'pings dropped, {reason}: {texts.get(reason) or "see the counters"}'


def _values(figures: Figures, rates: Mapping[str, float]) -> dict[str, str]:
    odometry, echoes = figures.odometry, figures.echoes
    counts, estimate = figures.mapper.counts, figures.mapper.estimate
    values = {
        'odometry rate [Hz]': f'{rates["odometry"]:.1f}', 'echo rate [Hz]': f'{rates["echoes"]:.1f}',
        'odometry received': str(odometry.received),
        'odometry refused': str(odometry.refused), 'odometry lost': str(odometry.lost),
        'echoes received': str(echoes.received), 'echoes lost': str(echoes.lost),
        'publishers with incompatible QoS': str(odometry.incompatible + echoes.incompatible),
        'pings received': str(counts.received), 'pings used': str(counts.used),
        'pings waiting': str(counts.waiting),
        **{f'pings dropped: {reason}': str(n) for reason, n in sorted(counts.dropped.items())},
        **figures.timings,
    }
    if estimate is not None and (path := estimate.trajectory) is not None:
        off = path.map_to_odom
        values |= {
            'pings localised': str(int(np.sum(~path.lost))), 'pings lost': str(int(path.lost.sum())),
            'least consistency': f'{path.consistency[~path.lost].min():.2f}',
            'correction': f'{1e3 * np.hypot(off.x, off.y):.1f} mm, {np.rad2deg(wrapped(off.yaw)):+.2f} deg',
            'slips': '; '.join(each.finding for each in estimate.cautions if each.code == 'slip') or '0'}
    if estimate is not None:
        values |= {
            'status': estimate.status, 'method': estimate.method,
            'edges': str(len(estimate.polygon.edges) if estimate.polygon else 0),
            **{name: str(len(found)) for name, found in (
                ('holes', estimate.holes), ('inner walls', estimate.inner_walls)) if found},
            'cost': '' if estimate.cost is None else f'{estimate.cost:.6g}',
            'IoU with free area': '' if estimate.iou_free_area is None else f'{estimate.iou_free_area:.4f}',
        }
    return values
