"""What is left for later is done in the executor's thread, one job at a time."""

import threading

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from polymap_ros.node.later import Later
from polymap_ros.node.stopwatch import Stopwatch


@pytest.fixture
def node():
    context = rclpy.context.Context()
    rclpy.init(context=context, args=[])
    node = Node('one_by_one', context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_jobs_are_done_one_by_one_in_the_executors_thread_with_what_else_waits_in_between(node):
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    later, done, ended = Later(node, Stopwatch()), [], threading.Event()

    def job(name, then=None):
        done.append((name, threading.get_ident()))
        if then:
            then()

    between = node.create_guard_condition(lambda: done.append(('message', threading.get_ident())))

    def ask():
        later('first', lambda: job('first', between.trigger))
        later('twice', lambda: job('not the newest'))
        later('twice', lambda: job('once', lambda: later('asked for by a job', lambda: job('last', ended.set))))

    asking = threading.Thread(target=ask)
    asking.start()
    asking.join()
    while not ended.is_set():
        executor.spin_once(timeout_sec=10.0)
    executor.shutdown()
    names, threads = zip(*done, strict=True)
    assert sorted(names) == ['first', 'last', 'message', 'once']
    assert names.index('first') < names.index('once') < names.index('last')
    assert set(threads) == {threading.get_ident()}
