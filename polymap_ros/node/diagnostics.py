"""What the node says about itself once a second: a state, its reason in words, and the figures."""

import re
import time
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.diagnostics import ERROR, OK, Figures, InputFigures, Watch, diagnostic_message
from polymap_ros.node.factory import make
from polymap_ros.node.inputs import Input
from polymap_ros.node.latency import Latency
from polymap_ros.node.qos import no_events
from polymap_ros.node.saving import Saver
from polymap_ros.node.solving import SolveLoop
from polymap_ros.node.starting import Starting
from polymap_ros.node.stopwatch import Stopwatch

TOLD = 'odometry is refused', 'incompatible QoS'
"""What the log has from the place where it happens, and so it has the problems."""

REPEAT_S = 60.0
"""The same kind of sentence is not logged again before this time."""


@dataclass
class Diagnosed:
    """What is looked at."""

    odometry: Input
    echoes: Input
    mapper: PolygonMapper
    latency: Latency
    solving: SolveLoop
    saver: Saver
    stopwatch: Stopwatch
    start: Starting


class Diagnostics:
    """Publishes `/diagnostics` and logs its warnings when they change."""

    def __init__(self, node: Node, parts: Diagnosed) -> None:
        self._node = node
        self._parts = parts
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10, event_callbacks=no_events())
        self._watch = Watch(time.monotonic())
        self._told_s: dict[str, float] = {}

    def publish(self) -> None:
        """Look, publish and log; called once a second."""
        now_s, stamp_ns = time.monotonic(), self._node.get_clock().now().nanoseconds
        figures = self._figures(self._timings())
        state = self._watch.look(now_s, figures)
        name = self._node.get_fully_qualified_name().lstrip('/')
        self._publisher.publish(diagnostic_message(make, stamp_ns, name, state))
        for level, text in state.findings:
            if level != OK and text not in figures.problems and not text.startswith(TOLD):
                self._log(level, text, now_s)

    def begin_anew(self) -> None:
        """The map is reset, and what it counted with it."""
        self._watch.begin_anew(self._figures())

    def _figures(self, timings: Mapping[str, str] = MappingProxyType({})) -> Figures:
        parts, solving = self._parts, self._parts.solving
        return Figures(_figures_of(parts.odometry), _figures_of(parts.echoes), parts.mapper, solving.paused,
                       solving.behind, solving.pace(), (solving.problem, parts.saver.problem), timings,
                       parts.start.state, self._crowds())

    def _crowds(self) -> tuple[str, ...]:
        """Inputs on which several publish; where sensors have frames of their own, several may send echoes."""
        parts = self._parts
        alone = (parts.odometry,) if parts.mapper.parameters.sensor.from_tf else (parts.odometry, parts.echoes)
        return tuple(filter(None, (each.crowd() for each in alone)))

    def _timings(self) -> dict[str, str]:
        parts = self._parts
        return {
            'latency p50 [ms]': f'{1e3 * parts.latency.percentile_s(50):.1f}',
            'latency p99 [ms]': f'{1e3 * parts.latency.percentile_s(99):.1f}',
            'solve time [s]': f'{parts.solving.solve_s:.3f}',
            'longest callback [ms]': f'{1e3 * parts.stopwatch.recent_s():.1f}',
            'longest callback since the start [ms]': f'{1e3 * parts.stopwatch.longest_s:.1f}',
            'longest callback': parts.stopwatch.longest,
            'saved': parts.saver.saved,
        }

    def _log(self, level: int, text: str, now_s: float) -> None:
        kind = re.sub(r'\b\d+(\.\d+)?\b', '', text.partition(':')[0])
        if now_s - self._told_s.get(kind, -REPEAT_S) >= REPEAT_S:
            self._told_s[kind] = now_s
            if level == ERROR:  # each in a line of its own, as rclpy allows one severity per line of code
                self._node.get_logger().error(text)
            else:
                self._node.get_logger().warning(text)


def _figures_of(each: Input) -> InputFigures:
    return InputFigures(each.topic, each.received, each.refused, each.lost, each.incompatible, each.refusal,
                        each.reason() if each.silent else '')
