"""Qualities of service: a best-effort writer is silently not heard by a reliable reader."""

from __future__ import annotations

from typing import Any

__all__ = ["events", "latched", "sensor_data"]


def sensor_data(*, is_reliable: bool = False) -> Any:
    """Return best effort, keeping the last five: it matches every publisher of a sensor.

    What is reliable does not hear a publisher with best effort, but loses nothing of the others.
    """
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

    return QoSProfile(
        depth=5,
        reliability=QoSReliabilityPolicy.RELIABLE
        if is_reliable
        else QoSReliabilityPolicy.BEST_EFFORT,
        durability=QoSDurabilityPolicy.VOLATILE,
    )


def latched(depth: int = 1) -> Any:
    """Return reliable and transient local: late subscribers hear what was published last."""
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

    return QoSProfile(
        depth=depth,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
    )


def events(depth: int = 10) -> Any:
    """Return the default of ROS 2: reliable and volatile."""
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

    return QoSProfile(
        depth=depth,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=QoSDurabilityPolicy.VOLATILE,
    )
