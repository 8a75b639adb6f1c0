"""zenoh's own configuration, from ours."""

from __future__ import annotations

import json
from typing import Any

import zenoh

from motiondlo.bus.config import BusConfig
from motiondlo.errors import ConfigError

RETRY_MS = 50
RETRY_MAX_MS = 250
"""A process that takes over for a dead one is there within 50 ms; a refused connection on loopback costs little."""
WAIT_BEFORE_DROP_US = 500
EXPRESS_QUEUE = 16
"""Batches waiting per link (zenoh's largest). An express message fills one of its own, and the default of 2 lost
messages at 1000 Hz whenever zenoh's sending thread was kept from running for 2 ms."""


def zenoh_config(config: BusConfig, shared_memory: bool) -> Any:
    """A zenoh.Config. Raises ConfigError for a setting that zenoh does not know or accept."""
    return _insert(
        {
            "mode": config.mode,
            "listen/endpoints": list(config.listen),
            "connect/endpoints": list(config.connect),
            # Only as a whole object does zenoh take it.
            "connect/retry": {
                "period_init_ms": RETRY_MS,
                "period_max_ms": RETRY_MAX_MS,
                "period_increase_factor": 1.5,
            },
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "transport/link/tx/lease": config.lease_ms,
            "transport/link/tx/queue/size/real_time": EXPRESS_QUEUE,
            "transport/link/tx/queue/size/interactive_high": EXPRESS_QUEUE,
            # A reader that is stuck must not hold up a sender's loop for longer than this per message.
            "transport/link/tx/queue/congestion_control/drop/wait_before_drop": WAIT_BEFORE_DROP_US,
            "transport/shared_memory/enabled": shared_memory,
            # Which messages go through shared memory is decided in shm.py alone.
            "transport/shared_memory/transport_optimization/enabled": False,
            **config.zenoh,
        }
    )


def private_config(endpoint: str, listens: bool) -> Any:
    """One end of a private link of two sessions within this process, for measurements."""
    return _insert(
        {
            "mode": "peer",
            "listen/endpoints": [endpoint] if listens else [],
            "connect/endpoints": [] if listens else [endpoint],
            "open/return_conditions/connect_scouted": False,
            "open/return_conditions/declares": False,
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "transport/shared_memory/enabled": True,
            "transport/shared_memory/transport_optimization/enabled": False,
        }
    )


def _insert(values: dict[str, Any]) -> Any:
    settings = zenoh.Config()
    for path, value in values.items():
        try:
            settings.insert_json5(path, json.dumps(value))
        except zenoh.ZError as error:
            raise ConfigError(f"zenoh does not accept {path} = {value!r}: {error}") from None
    return settings
