"""Real nodes in processes of their own, and a peer in the test's process that talks to them over DDS."""

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

pytest.importorskip('rclpy')

import rclpy
import tf2_build
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, odometry_message
from polymap_ros.node.factory import make, message_class
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

DEADLINE_S = 60.0
ODOMETRY, SCAN = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan'
PERIOD_NS = 500_000_000
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RELIABLE = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)


class Process:
    """A command of the package as a user starts it; its stderr is read line by line."""

    def __init__(self, command: str, arguments: list[str]) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, '-m', f'polymap_ros.commands.{command}', *arguments], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
            env={**os.environ, 'PYTHONFAULTHANDLER': '1'},
        )
        self.lines: list[str] = []
        self._queue: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            self._queue.put(line.rstrip())
        self._queue.put(None)

    def wait_for_line(self, text: str, timeout_s: float = DEADLINE_S) -> str:
        """The first line from here on that holds `text`."""
        end_s = time.monotonic() + timeout_s
        while (remaining_s := end_s - time.monotonic()) > 0.0:
            try:
                line = self._queue.get(timeout=remaining_s)
            except queue.Empty:
                break
            if line is None:
                break
            self.lines.append(line)
            if text in line:
                return line
        pytest.fail(f'{text!r} did not come; output:\n' + '\n'.join(self.lines))

    def end(self, timeout_s: float = DEADLINE_S) -> int:
        """Wait for the end; return the status, with all output in `lines`."""
        status = self.popen.wait(timeout_s)
        while (line := self._queue.get(timeout=timeout_s)) is not None:
            self.lines.append(line)
        if status < 0 and status != -signal.SIGKILL:
            pytest.fail(f'ended by signal {-status}; output:\n' + '\n'.join(self.lines))
        return status

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        """Signal the process group, as a terminal does, and wait for the end."""
        os.killpg(self.popen.pid, number)
        return self.end()

    def kill(self) -> None:
        if self.popen.poll() is None:
            os.killpg(self.popen.pid, signal.SIGKILL)
            self.popen.wait()


class Peer:
    """A node in this process with a context of its own."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, args=[])
        self.node = rclpy.create_node('peer', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def spin_until(
        self, condition: Callable[[], Any], what: str, timeout_s: float = DEADLINE_S, told: Callable[[], Any] = str,
    ) -> None:
        """Spin until a condition holds; else fail with `what` did not come, and what is `told` of it instead."""
        end_s = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > end_s:
                pytest.fail(f'within {timeout_s:g} s: {what} {told()}')
            self.executor.spin_once(timeout_sec=0.05)

    def listen(self, topic: str, type_name: str, qos: Any = LATCHED) -> list[Any]:
        """Subscribe; the returned list grows."""
        received: list[Any] = []
        self.node.create_subscription(message_class(type_name), topic, received.append, qos)
        return received

    def diagnostics(self, node: str = 'polymap_node') -> Callable[[], dict[str, str]]:
        """A function that gives the node's newest diagnostic values, with `level` and `message` among them."""
        received = self.listen('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', 10)

        def newest() -> dict[str, str]:
            found = [status for array in received for status in array.status if status.name.startswith(f'{node}:')]
            if not found:
                return {}
            values = {pair.key: pair.value for pair in found[-1].values}
            return {'level': str(found[-1].level[0]), 'message': found[-1].message, **values}

        return newest

    def until_used(self, values: Callable[[], dict[str, str]], count: int) -> None:
        """Spin until the diagnostics say that so many pings were used."""
        self.spin_until(lambda: values().get('pings used') == str(count), f'{count} pings used', told=values)

    def publisher(self, topic: str, type_name: str, qos: Any = RELIABLE, subscribers: int = 1) -> Any:
        """A publisher that has met its subscribers."""
        publisher = self.node.create_publisher(message_class(type_name), topic, qos)
        self.spin_until(lambda: publisher.get_subscription_count() >= subscribers, f'{topic} has no subscriber')
        return publisher

    def call(self, name: str, type_name: str, **request: Any) -> Any:
        """Call a service and return its response."""
        service = message_class(type_name)
        client = self.node.create_client(service, name)
        self.spin_until(client.service_is_ready, f'no service {name}')
        future = client.call_async(service.Request(**request))
        self.spin_until(future.done, f'no answer from {name}')
        self.node.destroy_client(client)
        return future.result()


class Ride:
    """Publishes pings of the triangular plate, with odometry at each and after the last."""

    def __init__(self, peer: Peer, namespace: str = '') -> None:
        scene = load_scene('triangle', None)
        self.poses, self.samples = scene.poses, simulate(scene)
        self.odometry = peer.publisher(f'{namespace}/odom', ODOMETRY)
        self.echo = peer.publisher(f'{namespace}/echo', SCAN)

    def publish(self, first, last, start_ns=0):
        for k in range(first, last):
            self.ping_at(k, start_ns)
        self.pose(start_ns + last * PERIOD_NS + PERIOD_NS // 2, last - 1)

    def ping_at(self, k, start_ns=0):
        """A ping and the odometry of its stamp; the node may take the two in either order."""
        stamp_ns = start_ns + (k + 1) * PERIOD_NS
        self.pose(stamp_ns, k)
        self.ping(stamp_ns, self.samples[k])

    def pose(self, stamp_ns, k):
        self.odometry.publish(odometry_message(make, stamp_ns, 'odom', Pose(*self.poses[k])))

    def ping(self, stamp_ns, samples, **changes):
        message = echo_message(make, Ping(stamp_ns, np.asarray(samples, np.float32), 1e-6))
        for name, value in changes.items():
            setattr(message, name, value)
        self.echo.publish(message)


@pytest.fixture(scope='module')
def tf2_msgs(request) -> Iterator[None]:
    """The type of /tf for this process and those it starts."""
    try:
        variables = tf2_build.environment(request.config.cache.mkdir('tf2_msgs'))
    except tf2_build.NotBuilt as error:
        pytest.skip(f'tf2_msgs could not be built: {error}')
    with pytest.MonkeyPatch.context() as patch:
        for name, value in variables.items():
            patch.setenv(name, value)
        if variables:
            tf2_build.load(variables)
        yield


@pytest.fixture(scope='module')
def make_peer() -> Iterator[Callable[[], Peer]]:
    """Makes peers that live as long as the module's tests."""
    peers: list[Peer] = []

    def make() -> Peer:
        peers.append(Peer())
        return peers[-1]

    yield make
    for each in peers:
        each.close()


@pytest.fixture(scope='module')
def starter() -> Iterator[Callable[..., Process]]:
    """Starts processes that live as long as the module's tests."""
    with launching() as launch:
        yield launch


@pytest.fixture
def peer() -> Iterator[Peer]:
    peer = Peer()
    yield peer
    peer.close()


@pytest.fixture
def riding(peer: Peer) -> Callable[..., Ride]:
    """Makes rides that publish in a namespace."""
    return lambda namespace='': Ride(peer, namespace)


@pytest.fixture
def start() -> Iterator[Callable[..., Process]]:
    """Starts ``polymap_node`` (or another command) and waits until it is ready."""
    with launching() as launch:
        yield launch


@contextmanager
def launching() -> Iterator[Callable[..., Process]]:
    processes: list[Process] = []

    def launch(*arguments: str, command: str = 'node', ready: str = 'ready:') -> Process:
        processes.append(Process(command, list(arguments)))
        if ready:
            processes[-1].wait_for_line(ready)
        return processes[-1]

    yield launch
    for process in processes:
        process.kill()
