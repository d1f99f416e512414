"""What the node says about itself once a second: a state, its reason in words, and the figures."""

import re
import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import Header

from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.markers import summary
from polymap_ros.node.inputs import Input
from polymap_ros.node.latency import Latency
from polymap_ros.node.qos import no_events
from polymap_ros.node.saving import Saver
from polymap_ros.node.solving import SolveLoop
from polymap_ros.node.stopwatch import Stopwatch

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

REPEAT_S = 60.0
"""The same kind of sentence is not logged again before this time."""

HOLD_S = 5.0
"""What happened within this time is still told, so that rare events do not make the state flicker."""


@dataclass
class Parts:
    """What is looked at."""

    odometry: Input
    echoes: Input
    mapper: PolygonMapper
    latency: Latency
    solving: SolveLoop
    saver: Saver
    stopwatch: Stopwatch


class Diagnostics:
    """Publishes `/diagnostics` and logs its warnings when they change."""

    def __init__(self, node: Node, parts: Parts) -> None:
        self._node = node
        self._parts = parts
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10, event_callbacks=no_events())
        self._then_s = time.monotonic()
        self._before = Counter[str]()
        self._recent = deque[tuple[float, Counter[str]]]()
        self._told_s: dict[str, float] = {}

    def publish(self) -> None:
        """Look, publish and log; called once a second."""
        now_s = time.monotonic()
        counts = self._counts()
        new = counts - self._before
        elapsed_s = max(now_s - self._then_s, 1e-6)
        rates = {name: new[name] / elapsed_s for name in ('odometry', 'echoes')}
        self._then_s, self._before = now_s, counts
        self._recent.append((now_s, new))
        while self._recent[0][0] <= now_s - HOLD_S:
            self._recent.popleft()
        findings = list(self._findings(sum((each for _, each in self._recent), Counter[str]())))
        level = max((level for level, _ in findings), default=OK)
        sentence = '; '.join(text for found, text in findings if found == level)
        values = self._values(rates)
        self._publisher.publish(DiagnosticArray(
            header=Header(stamp=self._node.get_clock().now().to_msg()),
            status=[DiagnosticStatus(
                level=level, name=f'{self._node.get_fully_qualified_name().lstrip("/")}: polygon mapping',
                message=sentence, hardware_id='',
                values=[KeyValue(key=key, value=value) for key, value in values.items()],
            )],
        ))
        for found, text in findings:
            if found != OK:
                self._log(found, text, now_s)

    def begin_anew(self) -> None:
        """The map is reset, and what it counted with it."""
        self._before = self._counts()
        self._recent.clear()

    def _counts(self) -> Counter[str]:
        parts = self._parts
        counts = Counter({f'dropped {reason}': n for reason, n in parts.mapper.counts.dropped.items()})
        counts.update({
            'odometry': parts.odometry.received, 'echoes': parts.echoes.received, 'used': parts.mapper.counts.used,
            'behind': parts.solving.behind,
            'odometry refused': parts.odometry.refused,
            'odometry lost': parts.odometry.lost, 'echoes lost': parts.echoes.lost,
        })
        return counts

    def _findings(self, new: Counter[str]) -> Iterator[tuple[bytes, str]]:
        """State and reason, most basic first; `new` holds what was counted in the last `HOLD_S`."""
        parts = self._parts
        if parts.solving.paused:
            yield OK, 'paused'
            return
        for each in (parts.odometry, parts.echoes):
            if each.silent:
                reason = each.reason()
                yield (ERROR if reason.startswith(('wrong type', 'incompatible')) else WARN), reason
        for each, name in ((parts.odometry, 'odometry lost'), (parts.echoes, 'echoes lost')):
            if new[name]:
                yield WARN, (f'messages lost on {each.topic}: {new[name]} in the last {HOLD_S:g} s; is the machine '
                             f'too busy, or qos_overrides.{each.topic}.subscription.depth too small?')
        if new['odometry'] and new['odometry refused'] >= new['odometry']:
            yield ERROR, f'odometry is refused: {parts.odometry.refusal}'
        yield from self._drops(new)
        counts = parts.mapper.counts
        missing = parts.mapper.missing_frame
        if counts.waiting and missing:
            yield WARN, f'{counts.waiting} pings wait for TF to connect their frame {missing!r} to the odometry\'s ' \
                        'child_frame_id (sensor.from_tf)'
        elif counts.waiting and new['echoes'] and not new['used'] and not parts.odometry.silent:
            yield WARN, f'{counts.waiting} pings wait for odometry: is it late, or are the clocks of the two apart?'
        if new['behind']:
            yield WARN, f'the solver is behind: {parts.solving.pace()}'
        for problem in (parts.solving.problem, parts.saver.problem):
            if problem:
                yield ERROR, problem
        estimate = parts.mapper.estimate
        if estimate is not None and estimate.status != 'closed':
            yield WARN, f'no polygon: {"; ".join(each.text for each in estimate.cautions) or estimate.status}'
        elif estimate is not None:
            for caution in estimate.cautions:
                yield WARN, caution.text
        first = estimate is None and counts.used > 0
        yield OK, f'{counts.used} pings; the first solve is to come' if first else summary(estimate)

    def _drops(self, new: Counter[str]) -> Iterator[tuple[bytes, str]]:
        texts = self._parts.mapper.last_drop_texts
        for name, count in new.items():
            kind, _, reason = name.partition(' ')
            if kind == 'dropped' and count > 0 and reason != 'paused':
                level = WARN if new['used'] else ERROR
                yield level, f'pings dropped, {reason}: {texts.get(reason) or "see the counters"}'

    def _values(self, rates: dict[str, float]) -> dict[str, str]:
        parts = self._parts
        counts, estimate = parts.mapper.counts, parts.mapper.estimate
        values = {
            'odometry rate [Hz]': f'{rates["odometry"]:.1f}', 'echo rate [Hz]': f'{rates["echoes"]:.1f}',
            'odometry received': str(parts.odometry.received),
            'odometry refused': str(parts.odometry.refused), 'odometry lost': str(parts.odometry.lost),
            'echoes received': str(parts.echoes.received), 'echoes lost': str(parts.echoes.lost),
            'publishers with incompatible QoS': str(parts.odometry.incompatible + parts.echoes.incompatible),
            'pings received': str(counts.received), 'pings used': str(counts.used),
            'pings waiting': str(counts.waiting),
            **{f'pings dropped: {reason}': str(n) for reason, n in sorted(counts.dropped.items())},
            'latency p50 [ms]': f'{1e3 * parts.latency.percentile_s(50):.1f}',
            'latency p99 [ms]': f'{1e3 * parts.latency.percentile_s(99):.1f}',
            'solve time [s]': f'{parts.solving.solve_s:.3f}',
            'longest callback [ms]': f'{1e3 * parts.stopwatch.recent_s():.1f}',
            'longest callback since the start [ms]': f'{1e3 * parts.stopwatch.longest_s:.1f}',
            'longest callback': parts.stopwatch.longest,
            'saved': parts.saver.saved,
        }
        if estimate is not None:
            values |= {
                'status': estimate.status, 'method': estimate.method,
                'edges': str(len(estimate.polygon.edges) if estimate.polygon else 0),
                'cost': '' if estimate.cost is None else f'{estimate.cost:.6g}',
                'IoU with free area': '' if estimate.iou_free_area is None else f'{estimate.iou_free_area:.4f}',
            }
        return values

    def _log(self, level: bytes, text: str, now_s: float) -> None:
        kind = re.sub(r'\b\d+(\.\d+)?\b', '', text.partition(':')[0])
        if now_s - self._told_s.get(kind, -REPEAT_S) >= REPEAT_S:
            self._told_s[kind] = now_s
            if level == ERROR:  # each in a line of its own, as rclpy allows one severity per line of code
                self._node.get_logger().error(text)
            else:
                self._node.get_logger().warning(text)

