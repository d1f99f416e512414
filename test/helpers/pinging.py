"""Sends pings on /echo: a process of its own that sends as many as each line of its stdin says, and then answers."""

import sys

import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy

from polymap_ros.acoustics.ping import Ping
from polymap_ros.messages.outputs import echo_message
from polymap_ros.node.factory import make, message_class

SAMPLES = 2048


def main() -> None:
    rclpy.init(args=[])
    node = rclpy.create_node('pinging')
    qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
    publisher = node.create_publisher(message_class('sensor_msgs/msg/LaserScan'), '/echo', qos)
    samples = np.random.default_rng(1).normal(size=SAMPLES).astype(np.float32)
    stamp_ns = int(sys.argv[1])
    for line in sys.stdin:
        for _ in range(int(line)):
            stamp_ns += 1
            publisher.publish(echo_message(make, Ping(stamp_ns, samples, 1e-6)))
        print(stamp_ns, flush=True)


if __name__ == '__main__':
    main()
