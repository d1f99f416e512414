"""A node that subscribes to odometry and echoes and does nothing: what rclpy itself costs."""

import sys

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from polymap_ros.node.factory import message_class
from polymap_ros.node.qos import played

TOPICS = {'odom': 'nav_msgs/msg/Odometry', 'echo': 'sensor_msgs/msg/LaserScan'}


def run_reference() -> None:
    """Receive until a signal comes."""
    rclpy.init(args=sys.argv)
    node = Node('polymap_reference')
    for topic, type_name in TOPICS.items():
        node.create_subscription(message_class(type_name), topic, lambda message: None, played())
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.get_logger().info('ready: receiving')
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.2)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    run_reference()
