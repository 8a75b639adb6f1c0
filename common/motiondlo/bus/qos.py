"""The topic table's words in zenoh's."""

from __future__ import annotations

from typing import Any, Final

import zenoh

from motiondlo.topics import Delivery, Priority, Topic

HEARTBEAT_S: Final = 0.2
"""How soon a reader of a reliable topic notices that it missed the last message."""

PRIORITIES: Final = {
    Priority.REAL_TIME: zenoh.Priority.REAL_TIME,
    Priority.INTERACTIVE_HIGH: zenoh.Priority.INTERACTIVE_HIGH,
    Priority.INTERACTIVE_LOW: zenoh.Priority.INTERACTIVE_LOW,
    Priority.DATA_HIGH: zenoh.Priority.DATA_HIGH,
    Priority.DATA: zenoh.Priority.DATA,
    Priority.BACKGROUND: zenoh.Priority.BACKGROUND,
}


def declare_publisher(session: Any, topic: Topic[Any], key: str) -> Any:
    """A zenoh publisher with the row's quality of service."""
    qos: dict[str, Any] = {
        "priority": PRIORITIES[topic.priority],
        # Never BLOCK: behind a reader that is stopped it waits for 5 s and then loses the messages all the same.
        "congestion_control": zenoh.CongestionControl.DROP,
        "express": topic.priority in (Priority.REAL_TIME, Priority.INTERACTIVE_HIGH),
    }
    if topic.delivery is not Delivery.RELIABLE:
        return session.declare_publisher(key, **qos)
    return zenoh.ext.declare_advanced_publisher(
        session,
        key,
        **qos,
        cache=zenoh.ext.CacheConfig(max_samples=topic.queue),
        sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S),
        publisher_detection=True,
    )


def declare_subscriber(session: Any, topic: Topic[Any], key: str, queue: int) -> Any:
    """A zenoh subscriber with a ring that keeps the newest ``queue`` messages."""
    ring: Any = zenoh.handlers.RingChannel(queue)
    if topic.delivery is not Delivery.RELIABLE:
        return session.declare_subscriber(key, ring)
    return zenoh.ext.declare_advanced_subscriber(
        session,
        key,
        ring,
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=topic.queue),
        recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
    )
