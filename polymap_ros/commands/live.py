"""The experiments of polymap_evaluate that run the real node: a long drive, and what a message costs."""

import argparse
import dataclasses
import os
import statistics
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from polymap_ros.commands import console
from polymap_ros.commands.ros import require_ros
from polymap_ros.errors import UsageError

if TYPE_CHECKING:
    from polymap_ros.node.observed import Observed

PROGRAM = 'polymap_evaluate'
ARGUMENTS = 'minutes', 'odom_hz', 'ping_hz', 'samples'
TOPICS = {'odom': 'nav_msgs/msg/Odometry', 'echo': 'sensor_msgs/msg/LaserScan'}
RELIABLE = [part for topic in TOPICS
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable',
                         '-p', f'qos_overrides./{topic}.subscription.depth:=1000')]
DOMAIN_ID = '77'
WAIT_S = 20.0
SPARSE_HZ = 2.0
ROUNDS = 5
NS = 1_000_000_000


@dataclass(frozen=True)
class Stream:
    """What is published, second for second."""

    odom_hz: float
    ping_hz: float
    n_samples: int

    @classmethod
    def of(cls, arguments: argparse.Namespace) -> 'Stream':
        """As the arguments say."""
        given = {name: getattr(arguments, name) for name in ARGUMENTS}
        for name, value in given.items():
            if value is not None and not 0.0 < value < float('inf'):
                raise UsageError(f'--{name.replace("_", "-")} {value:g}; allowed: above 0')
        return cls(given['odom_hz'] or 200.0, given['ping_hz'] or 20.0, given['samples'] or 8192)

    def pings(self) -> list[Any]:
        """Echo messages of one round."""
        from polymap_ros.acoustics.ping import Ping
        from polymap_ros.evaluation.round_trip import RoundTrip
        from polymap_ros.messages.outputs import echo_message
        from polymap_ros.node.factory import make

        console.complain(PROGRAM, 'simulating the pings of one round')
        return [echo_message(make, Ping(0, samples, 1e-6), 1.0 / self.ping_hz)
                for samples in RoundTrip(self.ping_hz, self.n_samples).samples()]

    def messages(self, duration_s: float, pings: list[Any]) -> Iterator[tuple[str, str, Any, int]]:
        """Odometry and echoes in the order of their times; a ping is there when its last sample is."""
        import numpy as np

        from polymap_ros.evaluation.round_trip import RoundTrip
        from polymap_ros.geometry.pose import Pose
        from polymap_ros.messages.outputs import odometry_message, time_message
        from polymap_ros.node.factory import make

        start_ns = time.time_ns()
        at_s = np.arange(round(duration_s * self.odom_hz) + 1) / self.odom_hz
        round_poses = RoundTrip(self.ping_hz, self.n_samples).poses(at_s)
        window_ns, k = round(self.n_samples * 1e-6 * NS), 0
        for ns, pose in zip((at_s * NS).astype(int).tolist(), round_poses.tolist(), strict=True):
            while pings and (ping_ns := round(k * NS / self.ping_hz)) + window_ns <= ns:
                pings[k % len(pings)].header.stamp = time_message(make, start_ns + ping_ns)
                yield 'echo', TOPICS['echo'], pings[k % len(pings)], start_ns + ping_ns + window_ns
                k += 1
            yield 'odom', TOPICS['odom'], odometry_message(make, start_ns + ns, 'odom', Pose(*pose)), start_ns + ns

    def expected(self, duration_s: float) -> tuple[int, int]:
        """Odometry and echo messages in `messages`."""
        end_ns = round(duration_s * self.odom_hz) * NS / self.odom_hz
        window_ns = round(self.n_samples * 1e-6 * NS)
        return round(duration_s * self.odom_hz) + 1, int((end_ns - window_ns) * self.ping_hz / NS + 1e-9) + 1


@dataclass(frozen=True)
class Second:
    """What was seen of the node in one second."""

    values: dict[str, object]

    def row(self) -> dict[str, object]:
        """Cells of results.csv."""
        return self.values


COLUMNS = {
    'odometry received': 'odometry_received', 'odometry lost': 'odometry_lost', 'odometry refused': 'odometry_refused',
    'echoes received': 'echoes_received', 'echoes lost': 'echoes_lost', 'pings used': 'pings_used',
    'latency p50 [ms]': 'latency_p50_ms', 'latency p99 [ms]': 'latency_p99_ms',
    'longest callback [ms]': 'longest_callback_ms', 'solve time [s]': 'solve_s', 'edges': 'edges',
}


class Record:
    """A row for every second."""

    def __init__(self, node: 'Observed') -> None:
        self.seconds: list[Second] = []
        self._node = node
        self._begun_s, self._then_s, self._cpu_s = time.monotonic(), time.monotonic(), node.cpu_s

    def add(self, now_s: float, values: dict[str, str]) -> None:
        """Look at the process when its diagnostics come."""
        cpu_s = self._node.cpu_s
        self.seconds.append(Second({
            'time_s': now_s - self._begun_s, 'cpu_share': (cpu_s - self._cpu_s) / max(now_s - self._then_s, 1e-3),
            'memory_mb': self._node.memory_bytes / 1e6, 'load_of_machine': os.getloadavg()[0],
            **{column: float(values.get(key) or 'nan') for key, column in COLUMNS.items()},
        }))
        self._then_s, self._cpu_s = now_s, cpu_s


def live(arguments: argparse.Namespace) -> 'tuple[list[Second], str]':
    """Drive for minutes with the real node, reliable; rows and a table."""
    require_ros()
    from polymap_ros.node.observed import Observed, Observer
    from polymap_ros.node.player import playing

    stream, duration_s = Stream.of(arguments), 60.0 * (arguments.minutes or 10.0)
    own_domain()
    pings = stream.pings()
    with Observed('polymap_ros.commands.node', ['--ros-args', *RELIABLE, *node_arguments(arguments)]) as node, \
            playing(TOPICS, 1.0, []) as player, Observer().listening() as listener:
        if lonely := player.wait(WAIT_S):
            raise UsageError(f'the node does not subscribe to {" and ".join(lonely)}')
        record = Record(node)
        listener.heard = record.add
        player.play(with_progress(stream.messages(duration_s, pings), duration_s))
        player.flush(WAIT_S)
        sent = stream.expected(duration_s)
        wanted = {'odometry received': str(sent[0]), 'pings used': str(sent[1])}
        listener.wait_for(lambda values: wanted.items() <= values.items(), WAIT_S)
        newest = listener.newest
    return record.seconds, live_table(record.seconds, newest, sent, node.status)


def with_progress(messages: Iterator[tuple[str, str, Any, int]], duration_s: float) -> Iterator[Any]:
    """The messages, with a progress bar of the drive's seconds."""
    first_ns, told = None, 0
    with console.progress(PROGRAM, round(duration_s), 's') as advance:
        for message in messages:
            first_ns = message[3] if first_ns is None else first_ns
            if (seconds := (message[3] - first_ns) // NS) > told:
                advance(seconds - told)
                told = seconds
            yield message


def live_table(seconds: 'list[Second]', newest: dict[str, str], sent: tuple[int, int], status: int | None) -> str:
    """What was sent and what became of it."""
    rows = [second.values for second in seconds]

    def column(name: str, part: slice = slice(None)) -> list[float]:
        values = [float(str(row[name])) for row in rows[part]]
        return [value for value in values if value == value] or [float('nan')]

    settled = slice(min(60, len(rows) // 2), None)
    memory = column('memory_mb', settled)
    lines = [
        ('odometry sent, received, lost', f'{sent[0]}, {newest.get("odometry received")}, '
                                          f'{sent[0] - int(newest.get("odometry received", 0))}'),
        ('pings sent, received, used', f'{sent[1]}, {newest.get("echoes received")}, {newest.get("pings used")}'),
        ('CPU share of one core, mean', f'{statistics.fmean(column("cpu_share")):.2f}'),
        ('memory after the first minute, at the end, at most [MB]',
         f'{memory[0]:.0f}, {memory[-1]:.0f}, {max(memory):.0f}'),
        ('latency of the newest 1000 pings, p50 median, p99 median and highest [ms]',
         f'{statistics.median(column("latency_p50_ms")):.1f}, {statistics.median(column("latency_p99_ms")):.1f}, '
         f'{max(column("latency_p99_ms")):.1f}'),
        ('longest callback [ms]', f'{newest.get("longest callback since the start [ms]")} '
                                  f'({newest.get("longest callback")})'),
        ('seconds with a callback over 20 ms', str(sum(each > 20.0 for each in column('longest_callback_ms')))),
        ('solve time, median and longest [s]',
         f'{statistics.median(column("solve_s")):.2f}, {max(column("solve_s")):.2f}'),
        ('load of the machine, mean', f'{statistics.fmean(column("load_of_machine")):.1f}'),
        ('exit status of the node', str(status)),
    ]
    return '\n'.join(['| | |', '| --- | --- |', *(f'| {name} | {value} |' for name, value in lines)])


def cpu(arguments: argparse.Namespace) -> 'tuple[list[Second], str]':
    """CPU of an idle node, of an odometry message and of a ping, beside a node that only subscribes.

    Measured in turn, as what a message costs depends on what else the machine does: from round to round by a fifth.
    """
    require_ros()
    stream, duration_s = Stream.of(arguments), 60.0 * (arguments.minutes or 0.2)
    own_domain()
    pings = stream.pings()
    never = ['-p', 'solver.period_s:=1000000.0']
    nodes = {
        'reference': ('polymap_ros.node.reference', []),
        'node, no solve': ('polymap_ros.commands.node', ['--ros-args', *RELIABLE, *node_arguments(arguments), *never]),
        'node': ('polymap_ros.commands.node', ['--ros-args', *RELIABLE, *node_arguments(arguments)]),
    }
    rows = [Second({'round': number, 'node': name, **cpu_of(module, command, stream, duration_s, pings)})
            for number in range(ROUNDS) for name, (module, command) in nodes.items()]
    return rows, cpu_table([row.values for row in rows])


def cpu_of(
    module: str, command: list[str], stream: Stream, duration_s: float, pings: list[Any]
) -> dict[str, object]:
    """Shares of a core while nothing comes, odometry, pings, and both; and what that makes per message."""
    from polymap_ros.node.observed import Observed
    from polymap_ros.node.player import playing

    with Observed(module, command) as node, playing(TOPICS, 1.0, []) as player:
        player.wait(WAIT_S)

        def share(part: Stream | None, ready: list[Any]) -> float:
            begun_s, cpu_s = time.monotonic(), node.cpu_s
            if part is None:
                threading.Event().wait(duration_s)
            else:
                player.play(with_progress(part.messages(duration_s, ready), duration_s))
                player.flush(WAIT_S)
            return (node.cpu_s - cpu_s) / (time.monotonic() - begun_s)

        idle, odometry = share(None, []), share(stream, [])
        sparse = dataclasses.replace(stream, odom_hz=SPARSE_HZ)  # enough for every ping to get its pose
        echoes, both = share(sparse, pings), share(stream, pings)
    odometry_s = (odometry - idle) / stream.odom_hz
    return {'idle_share': idle, 'odometry_us': 1e6 * odometry_s,
            'ping_us': 1e6 * (echoes - idle - odometry_s * SPARSE_HZ) / stream.ping_hz, 'share': both}


def cpu_table(rows: list[dict[str, Any]]) -> str:
    """A row per node: medians of its rounds, and of the ratios to the first node of the same round."""
    lines = ['| node | idle, of a core | an odometry message | a ping | both, of a core |',
             '| --- | --- | --- | --- | --- |']
    rounds: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        rounds.setdefault(row['node'], []).append(row)
    references = next(iter(rounds.values()))
    for node, own in rounds.items():
        each = (f'{statistics.median(row[name] for row in own):.0f} us, '
                f'{statistics.median(row[name] / first[name] for row, first in zip(own, references, strict=True)):.2f}x'
                for name in ('odometry_us', 'ping_us'))
        lines.append(f'| {node} | {statistics.median(row["idle_share"] for row in own):.1%} | {" | ".join(each)} | '
                     f'{statistics.median(row["share"] for row in own):.1%} |')
    return '\n'.join(lines)


def node_arguments(arguments: argparse.Namespace) -> list[str]:
    """The parameters of the command line, for the node."""
    console.read_parameters(PROGRAM, arguments)
    file = ['--params-file', str(arguments.params_file)] if arguments.params_file else []
    return [*file, *(part for text in arguments.overrides for part in ('-p', text))]


def own_domain() -> None:
    """Keep away from other nodes, unless a domain was chosen."""
    os.environ.setdefault('ROS_DOMAIN_ID', DOMAIN_ID)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
