"""result.mcap: the odometry, and the outputs as they grew, for Foxglove, Rerun and RViz."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.diagnostics import SILENCE_S, Figures, InputFigures, Watch, diagnostic_message
from polymap_ros.messages.latched import LATCHED, Latched
from polymap_ros.messages.newest_pose import POSE, POSE_TYPE, TF, TF_TYPE, NewestPose
from polymap_ros.parameters import NODE_NAME
from polymap_ros.recordings.reading import Message, Recording
from polymap_ros.recordings.replay import ODOMETRY_TYPE, Replay
from polymap_ros.recordings.writing import RecordingWriter, make
from polymap_ros.results.occupancy import Occupancy, occupancy_of
from polymap_ros.solvers.estimate import Estimate

SECOND_NS = 1_000_000_000
IDLE_NS = 60 * SECOND_NS
"""In a longer gap nothing is published after this time: where a clock was set, a gap may last for years."""

STEP_NS = {'evidence': 5_000_000, 'paper': 300_000}
"""From one checkpoint of a solve to the next, as measured on the recordings in bags/ (those of `rectangle` take no time
worth counting). Counted, so that a record depends on no clock, and takes no longer than what it records."""

OUTPUTS = {f'/{NODE_NAME}/{name}': kind for name, kind in LATCHED.items()}
POSES = f'/{NODE_NAME}/{POSE}'
DIAGNOSTICS, DIAGNOSTICS_TYPE = '/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray'


def write_outcome(
    path: Path, recording: Recording, answer: PolygonMapper, growing: PolygonMapper,
    start_s: float | None = None, end_s: float | None = None, advance: Callable[[int], object] = lambda _: None,
) -> None:
    """Write a bare .mcap file of the odometry and of what a node that ran meanwhile would have published.

    Each output has the log time at which the node's timer would have run. A solve is shown when it begins, and the
    next one does not begin before that would be done. The last output is the answer.

    Parameters
    ----------
    path : Path
        Must not exist.
    recording : Recording
        Open; it is replayed to `growing`.
    answer : PolygonMapper
        Solved; only its estimate is looked at.
    growing : PolygonMapper
        Such as `answer` was before the replay.
    start_s, end_s : float, optional
        The interval that was replayed [s].
    advance : callable
        Is told how many messages were done since the last time.
    """
    with RecordingWriter(path, latched=OUTPUTS, compressed=True) as writer:
        replay = Replay(recording, growing, growing.parameters, start_s, end_s)
        others = {POSES: POSE_TYPE, DIAGNOSTICS: DIAGNOSTICS_TYPE, **({TF: TF_TYPE} if _has_tf(growing) else {})}
        for topic, kind in {replay.odom_topic: ODOMETRY_TYPE, **OUTPUTS, **others}.items():
            writer.declare(topic, kind)
        timers = _Timers(writer, growing, replay, recording.start_ns + round(SECOND_NS * (start_s or 0.0)))
        replay.before = timers.before
        for _ in replay:
            advance(1)
        timers.end(answer)


def _has_tf(mapper: PolygonMapper) -> bool:
    """Whether a node would broadcast TF."""
    slam = mapper.parameters.slam
    return bool(slam.map_frame and slam.publish_tf)


class _Timers:
    """The timers of a node that started with the recording, on the clock of its log times."""

    def __init__(self, writer: RecordingWriter, mapper: PolygonMapper, replay: Replay, start_ns: int) -> None:
        self._writer, self._mapper, self._replay = writer, mapper, replay
        self._latched = Latched(make, self._send, NODE_NAME, self._grid_of)
        self._watch = Watch(0.0)
        self._period_ns = round(SECOND_NS * mapper.parameters.solver.period_s)
        self._step_ns = STEP_NS.get(mapper.parameters.solver.method, 0)
        self._solved_pings = 0
        self._start_ns = self._now_ns = self._then_ns = self._free_ns = start_ns
        self._heard_ns = dict.fromkeys(replay.topics, start_ns)
        self._newest = NewestPose(make, mapper)
        mapper.placed = self._place
        self._tf_ns = round(SECOND_NS * mapper.parameters.slam.tf_period_s) if _has_tf(mapper) else 0

    def before(self, entry: Message) -> None:
        """Publish what is due before a message comes; odometry is copied."""
        self._run_until(entry.log_ns)
        self._then_ns = self._heard_ns[entry.topic] = entry.log_ns
        if entry.topic == self._replay.odom_topic:
            self._writer.write(entry.topic, entry.message, entry.log_ns)

    def end(self, answer: PolygonMapper) -> None:
        """Publish the answer, a second after the last one at the latest."""
        self._now_ns = self._next(SECOND_NS, self._then_ns)
        self._mapper.estimate = answer.estimate
        self._show()
        self._look()

    def _run_until(self, end_ns: int) -> None:
        """Run the timers up to a log time; what they look at has not changed since the last message."""
        due = [*self._ticks(SECOND_NS, self._look, end_ns), *self._ticks(self._tf_ns, self._broadcast, end_ns)]
        solve_ns = self._next(self._period_ns, max(self._then_ns, self._free_ns))
        if solve_ns <= end_ns and self._mapper.counts.used != self._solved_pings:
            due.insert(0, (solve_ns, self._solve))
        for self._now_ns, run in sorted(due, key=lambda each: each[0]):
            run()

    def _ticks(self, period_ns: int, run: Callable[[], None], end_ns: int) -> list[tuple[int, Callable[[], None]]]:
        """When a timer runs up to a log time; one without a period does not."""
        if not period_ns:
            return []
        last_ns = min(end_ns, self._then_ns + IDLE_NS)
        return [(ns, run) for ns in range(self._next(period_ns, self._then_ns), last_ns + 1, period_ns)]

    def _next(self, period_ns: int, after_ns: int) -> int:
        """When a timer runs first after a log time [ns]."""
        return after_ns + period_ns - (after_ns - self._start_ns) % period_ns

    def _solve(self) -> None:
        self._solved_pings = self._mapper.counts.used
        self._free_ns = self._now_ns
        self._mapper.solve(self._step)
        self._show()

    def _step(self) -> None:
        self._free_ns += self._step_ns

    def _show(self) -> None:
        for publish in self._latched.drawn(self._mapper):
            publish()
        self._update()

    def _place(self, stamp_ns: int) -> None:
        """A ping has its place, by the message that came last."""
        self._now_ns = max(self._now_ns, self._then_ns)
        self._update()

    def _update(self) -> None:
        message = self._newest.updated()
        if message is not None:
            self._writer.write(POSES, message, self._now_ns)
            self._broadcast()

    def _broadcast(self) -> None:
        if self._tf_ns and (transforms := self._newest.transforms(self._now_ns)):
            self._writer.write(TF, make(TF_TYPE, transforms=transforms), self._now_ns)

    def _look(self) -> None:
        self._latched.publish_beam_map(self._mapper)
        replay = self._replay
        dropped = ', '.join(f'{number} {reason}' for reason, number in sorted(replay.odometry.dropped.items()))
        figures = Figures(
            InputFigures(replay.odom_topic, replay.odometry.received, replay.odometry.dropped.total(),
                         refusal=dropped, silence=self._silence(replay.odom_topic)),
            InputFigures(replay.echo_topic, replay.echoes, silence=self._silence(replay.echo_topic)), self._mapper)
        state = self._watch.look(1e-9 * (self._now_ns - self._start_ns), figures)
        self._writer.write(DIAGNOSTICS, diagnostic_message(make, self._now_ns, NODE_NAME, state), self._now_ns)

    def _silence(self, topic: str) -> str:
        silent_s = 1e-9 * (self._now_ns - self._heard_ns[topic])
        return f'no message on {topic} for {silent_s:.0f} s' if silent_s > SILENCE_S else ''

    def _send(self, name: str, message: Any) -> None:
        self._writer.write(f'/{NODE_NAME}/{name}', message, self._now_ns)

    def _grid_of(self, estimate: Estimate) -> Occupancy | None:
        return occupancy_of(estimate, self._mapper.parameters)
