"""The experiment "speed" of polymap_evaluate: what an equation, a solve, a replay and --help cost, as ratios."""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polymap_ros.commands import console
from polymap_ros.errors import UsageError

if TYPE_CHECKING:
    from polymap_ros.evaluation.growth import Growth
    from polymap_ros.evaluation.paired import Paired

PROGRAM = 'polymap_evaluate'
COMMANDS = 'node', 'replay', 'play', 'simulate', 'evaluate'
REPETITIONS, MINUTES = 20, 10.0
ODOM_HZ, PING_HZ, N_SAMPLES = 100.0, 10.0, 4096
NS = 1_000_000_000


def speed(arguments: argparse.Namespace) -> 'tuple[list[Any], str]':
    """Rows and a table."""
    if arguments.growth is not None:
        return _growth(arguments)
    if arguments.minutes is not None and not 0.0 < arguments.minutes < float('inf'):
        raise UsageError(f'--minutes {arguments.minutes:g}; allowed: above 0')
    rows = []
    with console.progress(PROGRAM, 6 + len(COMMANDS), 'row') as advance:
        for row in _rows(arguments):
            rows.append(row)
            advance(1)
    from polymap_ros.evaluation.paired import paired_table

    return rows, (f'{paired_table(rows)}\n\nCPU times, in one process on one core; the machine had a load of '
                  f'{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.')


def _growth(arguments: argparse.Namespace) -> 'tuple[list[Growth], str]':
    from polymap_ros.evaluation.growth import growth, growth_table

    rows = []
    with console.progress(PROGRAM, None, 'row') as advance:
        for row in growth(console.read_parameters(PROGRAM, arguments), arguments.growth):
            rows.append(row)
            advance(1)
    return rows, growth_table(rows)


def _rows(arguments: argparse.Namespace) -> 'Iterator[Paired]':
    from polymap_ros.evaluation.speed_experiment import (
        Drive,
        beamforming_cost,
        matched_filter_cost,
        overlap_cost,
        solve_costs,
    )

    parameters, repetitions = console.read_parameters(PROGRAM, arguments), arguments.repetitions or REPETITIONS
    yield matched_filter_cost(parameters, repetitions)
    yield beamforming_cost(repetitions)
    drive = Drive(parameters)
    drive.go(drive.trip.pings_per_round)
    yield overlap_cost(drive.mapper, repetitions)
    yield from solve_costs(drive, repetitions)
    yield replay_cost(arguments.minutes or MINUTES, max(1, repetitions // 4))
    for name in COMMANDS:
        yield help_cost(name, max(1, repetitions // 2))


def replay_cost(minutes: float, repetitions: int) -> 'Paired':
    """polymap_replay of a drive, and reading and decoding the same messages with rosbags."""
    import dataclasses

    from polymap_ros.commands import replay
    from polymap_ros.evaluation.paired import paired

    duration_s = 60.0 * minutes
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'drive.mcap')
        _record(path, duration_s)

        def mapped() -> None:
            with console.unseen():
                replay.main([str(path), '--output', str(Path(folder, 'out'))])

        mapped()  # what is compiled, and imported, on first use
        result = paired((f'polymap_replay of {minutes:g} minutes, {ODOM_HZ:g} Hz odometry, {PING_HZ:g} Hz pings of '
                         f'{N_SAMPLES} samples', mapped),
                        ('reading and decoding it with rosbags', lambda: _decode(path)), repetitions, '<= 4')
    faster = duration_s / result.seconds
    return dataclasses.replace(result, note=f'{faster:.0f} times as fast as real time (target: 100)')


def _record(path: Path, duration_s: float) -> None:
    import numpy as np

    from polymap_ros.acoustics.ping import Ping
    from polymap_ros.evaluation.round_trip import RoundTrip
    from polymap_ros.geometry.pose import Pose
    from polymap_ros.messages.outputs import echo_message, odometry_message
    from polymap_ros.recordings.writing import RecordingWriter, make

    trip, start_ns = RoundTrip(PING_HZ, N_SAMPLES), NS
    samples = trip.samples()
    at_s = np.arange(round(duration_s * ODOM_HZ) + 1) / ODOM_HZ
    each = round(ODOM_HZ / PING_HZ)
    with RecordingWriter(path) as writer:
        for k, (second, pose) in enumerate(zip(at_s.tolist(), trip.poses(at_s).tolist(), strict=True)):
            ns = start_ns + round(second * NS)
            writer.write('/odom', odometry_message(make, ns, 'odom', Pose(*pose)), ns)
            if k % each == 0:
                ping = Ping(ns, samples[k // each % len(samples)], 1e-6)
                writer.write('/echo', echo_message(make, ping, 1.0 / PING_HZ), ns)


def _decode(path: Path) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)


def help_cost(name: str, repetitions: int) -> 'Paired':
    """``--help`` of a command, and an interpreter that does nothing."""
    import dataclasses

    from polymap_ros.evaluation.paired import paired

    def started(code: str) -> None:
        subprocess.run([sys.executable, '-c', code], check=True, stdout=subprocess.DEVNULL)

    result = paired(
        (f'polymap_{name} --help',
         lambda: started(f'from polymap_ros.commands.{name} import main; main(["--help"])')),
        ('python -c pass', lambda: started('pass')), repetitions, '<= 0.3 s more', clock=_cpu_of_children)
    return dataclasses.replace(result, note=f'{result.seconds - result.reference_seconds:.2f} s more')


def _cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
