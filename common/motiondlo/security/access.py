"""What zenoh is told: TLS for both ends of the gate, and the gate's access control, from the table of roles.

Two kinds of links end at the gate: those from outside over TLS, whose certificate gives a role, and those to the
cell's own daemons over loopback or unix sockets. Whatever no rule allows is denied, in both directions: the gate would
not even hear an event batch or a correction.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from motiondlo.messages.command import Verb
from motiondlo.security.roles import ROLES, Role, role_of
from motiondlo.topics import ALIVE, COMMAND, HEALTH, STATE, Topic

Rule = dict[str, Any]

OUTSIDE_PROTOCOLS: Final = ("tls",)
CELL_PROTOCOLS: Final = ("tcp", "unixsock-stream")
LAST_VALUE_HZ: Final = 50.0
COMMAND_HZ: Final = 20.0
_OPEN_READS: Final = (STATE, HEALTH)
"""What any role reads; the gate asks the cell for nothing else."""


def access_control(
    cell: str, gate: str, clients: Iterable[str], commands: Mapping[str, tuple[Verb, ...]]
) -> dict[str, Any]:
    """zenoh's ``access_control`` for the gate called ``gate`` in ``cell``.

    clients: common names that are let in. commands: verbs per role; a role that is absent gives none.
    Raises MotionDLOError for a name without a role.
    """
    names_of: dict[str, list[str]] = {role.name: [] for role in ROLES}
    for name in clients:
        names_of[role_of(name).name].append(name)
    rules: list[Rule] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for role in ROLES:
        own = _outside_rules(cell, role, commands.get(role.name, ()))
        if own and names_of[role.name]:
            rules += own
            subjects.append(
                {
                    "id": role.name,
                    "cert_common_names": names_of[role.name],
                    "link_protocols": list(OUTSIDE_PROTOCOLS),
                }
            )
            policies.append({"rules": [rule["id"] for rule in own], "subjects": [role.name]})
    own = _cell_rules(cell, gate)
    rules += own
    subjects.append({"id": "cell", "link_protocols": list(CELL_PROTOCOLS)})
    policies.append({"rules": [rule["id"] for rule in own], "subjects": ["cell"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def size_limits() -> list[dict[str, Any]]:
    """zenoh's ``low_pass_filter``: what comes from outside carries no more than a command may."""
    return [
        {
            "id": "sizes",
            "link_protocols": list(OUTSIDE_PROTOCOLS),
            "flows": ["ingress"],
            "messages": ["put", "delete", "query", "reply"],
            "key_exprs": ["**"],
            "size_limit": COMMAND.max_payload_bytes,
        }
    ]


def rate_limits(cell: str, commands: Mapping[str, tuple[Verb, ...]]) -> list[dict[str, Any]]:
    """zenoh's ``downsampling``: how often each visitor may ask, so that no visitor keeps a daemon busy with answers."""
    verbs = sorted({verb for own in commands.values() for verb in own})
    rules = [{"key_expr": _key(topic, cell), "freq": LAST_VALUE_HZ} for topic in _OPEN_READS]
    rules += [{"key_expr": COMMAND.key(cell, verb), "freq": COMMAND_HZ} for verb in verbs]
    return [
        {
            "id": "questions",
            "link_protocols": list(OUTSIDE_PROTOCOLS),
            "flows": ["ingress"],
            "messages": ["query"],
            "rules": rules,
        }
    ]


def largest_message_bytes() -> int:
    """The largest message that passes the gate, with room for zenoh's own headers."""
    return max(topic.max_payload_bytes for topic in (*_OPEN_READS, COMMAND)) + (64 << 10)


def _outside_rules(cell: str, role: Role, verbs: tuple[Verb, ...]) -> list[Rule]:
    rules: list[Rule] = []
    reads = [_key(topic, cell) for topic in role.reads]
    asks = reads + [COMMAND.key(cell, verb) for verb in verbs]
    if reads:
        rules.append(_rule(f"{role.name}-subscribes", ["declare_subscriber"], ["ingress"], reads))
        rules.append(_rule(f"{role.name}-receives", ["put"], ["egress"], reads))
    if asks:
        rules.append(_rule(f"{role.name}-asks", ["query"], ["ingress"], asks))
        rules.append(_rule(f"{role.name}-is-answered", ["reply", "declare_queryable"], ["egress"], asks))
    return rules


def _cell_rules(cell: str, gate: str) -> list[Rule]:
    reads = [_key(topic, cell) for topic in _OPEN_READS]
    asks = [*reads, COMMAND.key(cell, "*")]
    own = [HEALTH.key(cell, gate)]
    alive = [ALIVE.key(cell, gate)]
    return [
        _rule("cell-is-subscribed-to", ["declare_subscriber"], ["egress"], reads),
        _rule("cell-publishes", ["put"], ["ingress"], reads),
        _rule("cell-is-asked", ["query"], ["egress"], asks),
        _rule("cell-answers", ["reply", "declare_queryable"], ["ingress"], asks),
        # The gate's own health and liveliness, towards the cell.
        _rule("cell-subscribes-to-health", ["declare_subscriber", "query"], ["ingress"], [HEALTH.key(cell, "*")]),
        _rule("cell-receives-health", ["put", "reply", "declare_queryable"], ["egress"], own),
        _rule(
            "cell-watches-liveliness",
            ["declare_liveliness_subscriber", "liveliness_query"],
            ["ingress"],
            [ALIVE.key(cell, "*")],
        ),
        _rule("cell-sees-the-gate", ["liveliness_token"], ["egress"], alive),
    ]


def _key(topic: Topic[Any], cell: str) -> str:
    return topic.key(cell, "*" if "{name}" in topic.suffix else "")


def _rule(name: str, messages: list[str], flows: list[str], keys: list[str]) -> Rule:
    return {"id": name, "permission": "allow", "messages": messages, "flows": flows, "key_exprs": keys}
