"""The gate with real sessions: nothing without a certificate, and with one exactly what its role may."""

from __future__ import annotations

import os
import socket
import stat
import time
from pathlib import Path

import psutil
import pytest
import zenoh
from tests.live.security.conftest import CELL, Gate, SmallCell, a_state

from motiondlo.bus.config import BusConfig
from motiondlo.bus.errors import BusError, CommandError
from motiondlo.bus.session import Bus, open_bus
from motiondlo.bus.settings import zenoh_config
from motiondlo.client import StateSubscriber
from motiondlo.messages.command import VERBS, CommandRequest, Verb
from motiondlo.messages.header import Stamp
from motiondlo.security.folder import CertificateFolder
from motiondlo.security.tls import tls_settings
from motiondlo.topics import ALIVE, COMMAND, CORRECTION, HEALTH, STATE, TOPICS, all_keys

pytestmark = pytest.mark.live

SETTLE_S = 0.3
FORBIDDEN = [topic for topic in TOPICS if topic.message is not None and topic not in (STATE, HEALTH, COMMAND)]


def refused(config: BusConfig) -> bool:
    try:
        with open_bus(config.model_copy(update={"open_timeout_s": 0.5}), "intruder") as bus:
            return bus.subscriber(STATE).recv(1.0) is None
    except BusError:
        return True


def answers(session: zenoh.Session, key: str, payload: bytes = b"", timeout_s: float = 1.0) -> list[bytes]:
    replies = session.get(key, zenoh.handlers.RingChannel(64), payload=payload, timeout=timeout_s)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]


def command(verb: Verb) -> bytes:
    return CommandRequest(verb=verb).to_bytes(Stamp(0, CELL, "intruder", time.monotonic_ns()))


def test_without_a_certificate_there_is_nothing(gate: Gate) -> None:
    """No certificate, TLS with the authority known but nothing to show, and no TLS at all."""
    port = int(gate.endpoint.rpartition(":")[2])
    authority = {"transport/link/tls/root_ca_certificate": str(gate.folder.certificate("authority"))}
    assert refused(BusConfig(cell=CELL, mode="client", connect=(gate.endpoint,), zenoh=authority))
    assert refused(BusConfig(cell=CELL, mode="client", connect=(gate.endpoint,)))
    assert refused(BusConfig(cell=CELL, mode="client", connect=(f"tcp/127.0.0.1:{port}",)))
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as plain:
        plain.sendall(b"GET / HTTP/1.0\r\n\r\n" + os.urandom(2000))
        plain.settimeout(5.0)
        try:
            said = plain.recv(4096)
        except ConnectionResetError:
            said = b""
        assert len(said) < 100, "at most a TLS alert"
    assert not refused(gate.visitor("monitor")), "the gate is still there for others"


def test_expired_foreign_unlisted_and_misused_certificates_are_refused(gate: Gate, tmp_path: Path) -> None:
    assert refused(gate.visitor("monitor.old")), "expired, although listed"
    assert refused(gate.visitor("monitor.unlisted"))
    assert refused(gate.visitor("daemon")), "a server's certificate is no client's"
    foreign = CertificateFolder(tmp_path / "foreign")
    foreign_authority = gate.folder.certificate("authority").read_bytes()
    assert refused(BusConfig.model_validate(gate.visitor("monitor").model_dump() | {"zenoh": _shown_by(foreign, gate)}))
    assert foreign_authority == gate.folder.certificate("authority").read_bytes()


def _shown_by(foreign: CertificateFolder, gate: Gate) -> dict[str, object]:
    # Trusts the true authority, so that only what it shows is foreign.
    return dict(gate.visitor("monitor").zenoh) | {
        "transport/link/tls/connect_certificate": str(foreign.certificate("monitor")),
        "transport/link/tls/connect_private_key": str(foreign.key("monitor")),
    }


def test_a_monitor_reads_state_and_health_and_nothing_else(gate: Gate, cell: SmallCell) -> None:
    config = gate.visitor("monitor")
    with open_bus(config, "screen") as bus:
        states, health = bus.subscriber(STATE), bus.subscriber(HEALTH)
        everything = bus.tap()
        assert [states.recv(5.0) is not None for _ in range(20)] == [True] * 20
        daemons = {message.daemon for _ in range(12) if (message := health.recv(5.0)) is not None}
        assert daemons == {"fusion", "gate"}
        last = bus.last_value(STATE, timeout_s=5.0)
        assert last is not None
        assert last.mode == "MOTION"
        heard = {item[0] for _ in range(5000) if (item := everything.recv()) is not None}
        assert heard <= {STATE.key(CELL), HEALTH.key(CELL, "fusion"), HEALTH.key(CELL, "gate")}
        assert bus.watch_alive().take(SETTLE_S) is None, "not even who is there"
        for verb in VERBS:
            with pytest.raises(CommandError):
                bus.ask(verb, timeout_s=0.3)
    with zenoh.open(zenoh_config(config, False)) as session:
        for topic in FORBIDDEN:
            assert answers(session, topic.key(CELL), timeout_s=0.3) == []
        assert answers(session, all_keys(CELL), timeout_s=0.3) == []
        assert answers(session, COMMAND.key(CELL, "pause"), command("pause"), 0.3) == []
        tokens = session.liveliness().get(ALIVE.key(CELL, "*"), zenoh.handlers.RingChannel(9), timeout=0.3)
        assert not list(tokens)
    assert not cell.commands


def test_what_the_cell_sends_itself_does_not_leave_it(gate: Gate, cell: SmallCell) -> None:
    with open_bus(gate.visitor("monitor"), "screen") as bus, inside(cell) as peer:
        subscribers = [bus.subscriber(topic) for topic in FORBIDDEN]
        everything = bus.tap(4096)
        states = bus.subscriber(STATE)
        assert states.recv(5.0) is not None
        before = cell.heard.copy()
        for topic in FORBIDDEN:
            for _ in range(10):
                peer.put(topic.key(CELL), b"inner matters")
        time.sleep(SETTLE_S)
        for topic, subscriber in zip(FORBIDDEN, subscribers, strict=True):
            assert cell.heard[topic.name] - before[topic.name] == 10, "it was sent"
            assert subscriber.status().received + subscriber.status().rejected == 0
            assert subscriber.recv() is None
        assert all(item[1] != b"inner matters" for _ in range(4096) if (item := everything.recv()) is not None)


def inside(cell: SmallCell) -> zenoh.Session:
    """A session within the cell, of another daemon."""
    config = cell.section.of_daemon(CELL, "segmenter")
    session = zenoh.open(zenoh_config(config, False))
    time.sleep(SETTLE_S)
    return session


@pytest.mark.parametrize("who", ["monitor", "gateway"])
def test_nobody_outside_can_publish_anything(gate: Gate, cell: SmallCell, who: str) -> None:
    with open_bus(gate.visitor(who), who) as bus:
        assert bus.subscriber(STATE).recv(5.0) is not None
        before = set(cell.heard)
        bus.publisher(CORRECTION)  # with its cache and its liveliness token
        with zenoh.open(zenoh_config(gate.visitor(who), False)) as session:
            forged = a_state(10**9).to_bytes(Stamp(10**6, CELL, "fusion", time.monotonic_ns()))
            for topic in TOPICS:
                key = topic.key(CELL, "forged") if "{name}" in topic.suffix else topic.key(CELL)
                session.put(key, forged)
                session.delete(key)
            token = session.liveliness().declare_token(ALIVE.key(CELL, "forged"))
            answer = session.declare_queryable(COMMAND.key(CELL, "set_region"), zenoh.handlers.RingChannel(9))
            with inside(cell) as peer:
                alive = peer.liveliness().get(ALIVE.key(CELL, "*"), zenoh.handlers.RingChannel(9), timeout=1.0)
                assert {str(reply.ok.key_expr).rpartition("/")[2] for reply in alive if reply.ok} == {"fusion", "gate"}
                assert answers(peer, COMMAND.key(CELL, "set_region"), command("set_region"), 0.3) == []
            token.undeclare()
            answer.undeclare()
        time.sleep(SETTLE_S)
        assert set(cell.heard) <= before | {"health/gate", "health/fusion", "state"}
        assert "correction" not in cell.heard
        assert cell.lost_states == 0, "a forged state would have had another number"


def test_a_gateway_gives_the_commands_that_it_may(gate: Gate, cell: SmallCell) -> None:
    with open_bus(gate.visitor("gateway"), "plc") as bus:
        assert bus.subscriber(STATE).recv(5.0) is not None
        assert bus.subscriber(HEALTH).recv(5.0) is not None
        (answer,) = bus.ask("pause", timeout_s=5.0)
        assert answer.result == {"done": True}
        assert bus.ask("reset", timeout_s=5.0)[0].ok
        for verb in ("get_config", "set_region", "segment"):
            with pytest.raises(CommandError):
                bus.ask(verb, timeout_s=0.3)
    with zenoh.open(zenoh_config(gate.visitor("gateway"), False)) as session:
        time.sleep(SETTLE_S)
        giant = command("pause") + bytes(COMMAND.max_payload_bytes)
        assert answers(session, COMMAND.key(CELL, "pause"), giant, 0.3) == []
        assert answers(session, COMMAND.key(CELL, "*"), command("pause"), 0.3) == []
    assert cell.commands == {"pause": 1, "reset": 1}


def test_a_visitor_that_asks_without_end_is_slowed_down(gate: Gate, cell: SmallCell) -> None:
    with zenoh.open(zenoh_config(gate.visitor("gateway"), False)) as session:
        time.sleep(SETTLE_S)
        start = time.monotonic()
        for _ in range(500):
            session.get(
                COMMAND.key(CELL, "pause"), zenoh.handlers.RingChannel(1), payload=command("pause"), timeout=0.1
            )
        time.sleep(SETTLE_S)
        assert 1 <= cell.commands["pause"] <= 2 + 20 * (time.monotonic() - start)


def test_KILLED_gate_leaves_the_cell_undisturbed_and_visitors_come_back(gate: Gate, cell: SmallCell) -> None:
    with open_bus(gate.visitor("monitor"), "screen") as bus:
        states = bus.subscriber(STATE)
        assert states.recv(5.0) is not None
        cell.state_gaps_s.clear()
        gate.kill()
        time.sleep(SETTLE_S)
        states.newest()
        assert states.recv(0.5) is None, "the gate was the only way"
        gate.start()
        assert states.recv(20.0) is not None, "the same session"
    assert cell.lost_states == 0
    assert max(cell.state_gaps_s) < 0.15, "no gap in host time"


def test_only_the_gate_listens_beyond_loopback_and_only_with_tls(gate: Gate, cell: SmallCell) -> None:
    port = int(gate.endpoint.rpartition(":")[2])
    listening = [c.laddr for c in psutil.Process(gate.child.pid).net_connections("inet") if c.status == "LISTEN"]
    assert [address.port for address in listening] == [port]
    own = [c.laddr for c in psutil.Process().net_connections("inet") if c.status == "LISTEN"]
    assert {address.ip for address in own} <= {"127.0.0.1"}
    if cell.section.socket_folder:
        assert not own, "no port at all"
        run = Path(cell.section.socket_folder)
        assert stat.S_IMODE(run.stat().st_mode) == 0o700
        assert (run / "fusion.sock").is_socket()


def test_the_client_comes_in_with_a_certificate(gate: Gate) -> None:
    tls = tls_settings(gate.folder, "monitor", listens=False)
    with StateSubscriber(gate.endpoint, CELL, same_host=False, tls=tls) as client:
        assert client.next(timeout_s=5.0).mode == "MOTION"
        assert client.last_value(timeout_s=5.0) is not None
        assert not client.stale


def visitors(bus: Bus) -> str:
    """What the gate's health says of its visitors, soon after."""
    health = bus.subscriber(HEALTH, "gate")
    names = ""
    for _ in range(8):
        message = health.recv(2.0)
        names = str(message.info["visitor_names"]) if message is not None else ""
    return names


def test_the_gates_health_names_its_visitors(gate: Gate) -> None:
    with open_bus(gate.visitor("monitor"), "screen") as bus, open_bus(gate.visitor("gateway"), "plc"):
        assert visitors(bus) == "gateway, monitor"
