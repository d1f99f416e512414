"""Every QoS profile of the node and the player, in one place."""

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

INPUT_DEPTH = 100


def sensor_input() -> QoSProfile:
    """Odometry and echoes: taken from any publisher, deep enough for bursts."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=INPUT_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT,
                      durability=DurabilityPolicy.VOLATILE)


def no_events() -> PublisherEventCallbacks:
    """Of publishers that offer all that a subscriber may ask for.

    Every event that is watched, two for each publisher, takes its time in each round of the executor; a subscriber of
    another type or with deadlines is warned by its own node.
    """
    return PublisherEventCallbacks(use_default_callbacks=False)


def latched_output() -> QoSProfile:
    """Maps (REP-2003): the last one is there for whoever comes late."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)


def played() -> QoSProfile:
    """What the player publishes: reliable, so that a subscriber may choose."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1000, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.VOLATILE)


def overridable() -> QoSOverridingOptions:
    """What ``qos_overrides.<topic>.subscription.*`` may change."""
    return QoSOverridingOptions(
        (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY))
