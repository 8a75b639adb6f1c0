"""What the gate tells zenoh, and what it reports."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from pydantic import ValidationError

from motiondlo.bus.settings import zenoh_config
from motiondlo.errors import ConfigError
from motiondlo.messages.command import VERBS
from motiondlo.security.access import access_control
from motiondlo.security.certificates import init, issue_holder, renew
from motiondlo.security.folder import CertificateFolder
from motiondlo.topics import COMMAND, HEALTH, STATE, TOPICS
from motiondlo_services.gate.config import GateConfig
from motiondlo_services.gate.core import GateCore, check_certificates, gate_session
from motiondlo_services.runtime.bus_section import BusSection

NOW = datetime(2030, 5, 1, tzinfo=UTC)


@pytest.fixture
def folder(tmp_path: Path) -> CertificateFolder:
    made = CertificateFolder(tmp_path / "certs")
    init(made, "c", NOW)
    issue_holder(made, "daemon", "", NOW, hosts=("localhost",))
    return made


def test_zenoh_accepts_every_setting(folder: CertificateFolder) -> None:
    section = BusSection(socket_folder="/run/motiondlo")
    session = gate_session("c", "gate", section.all_endpoints().values(), GateConfig(), folder, 800)
    assert session.listen == ("tls/0.0.0.0:7447",)
    assert all(endpoint.startswith("unixsock-stream//run/motiondlo/") for endpoint in session.connect)
    zenoh_config(session, False)


def test_access_control_lets_through_what_the_roles_may_and_no_more() -> None:
    made = access_control("c", "gate", ["monitor", "monitor.hall", "gateway.plc"], {"gateway": ("pause",)})
    assert made["default_permission"] == "deny"
    assert {rule["permission"] for rule in made["rules"]} == {"allow"}
    rules = {rule["id"]: rule for rule in made["rules"]}
    of = {subject["id"]: subject for subject in made["subjects"]}
    assert of["monitor"]["cert_common_names"] == ["monitor", "monitor.hall"]
    assert of["gateway"]["cert_common_names"] == ["gateway.plc"]
    for subject in of.values():
        assert ("cert_common_names" in subject) == (subject["link_protocols"] == ["tls"])
    reads = {STATE.key("c"), HEALTH.key("c", "*")}
    for policy in made["policies"]:
        (who,) = policy["subjects"]
        if who == "cell":
            continue
        allowed = [rules[name] for name in policy["rules"]]
        commands = {COMMAND.key("c", "pause")} if who == "gateway" else set()
        for rule in allowed:
            assert set(rule["key_exprs"]) <= reads | commands
            if "ingress" in rule["flows"]:
                assert set(rule["messages"]) <= {"declare_subscriber", "query"}, "nothing is published from outside"
    inner = {topic.key("c", "*") if "{name}" in topic.suffix else topic.key("c") for topic in TOPICS}
    sent = {
        key
        for rule in made["rules"]
        if "egress" in rule["flows"] and "put" in rule["messages"]
        for key in rule["key_exprs"]
    }
    assert sent & (inner - reads) == set()


def test_nobody_listed_means_that_nobody_gets_in() -> None:
    made = access_control("c", "gate", [], {"gateway": VERBS})
    assert [subject["id"] for subject in made["subjects"]] == ["cell"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"listen": "tcp/0.0.0.0:7447"},
        {"listen": "tls/0.0.0.0"},
        {"visitors": ("king",)},
        {"visitors": ("daemon",)},
        {"visitors": ("monitor.*",)},
        {"gateway_commands": ("format_disk",)},
        {"max_visitors": 0},
    ],
    ids=str,
)
def test_a_wrong_setting_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        GateConfig.model_validate(wrong)


def test_the_gate_does_not_start_with_certificates_that_are_not_safe(folder: CertificateFolder) -> None:
    check_certificates(GateConfig(), folder, NOW)
    with pytest.raises(ConfigError, match="expired"):
        check_certificates(GateConfig(), folder, NOW + timedelta(days=366))
    folder.key("daemon").chmod(0o644)
    with pytest.raises(ConfigError, match="open to others"):
        check_certificates(GateConfig(), folder, NOW)


def test_expiry_and_renewal_show_up_in_health(folder: CertificateFolder) -> None:
    core = GateCore(GateConfig(), folder)
    assert not core.look(NOW)
    late = NOW + timedelta(days=350)
    assert core.look(late)
    assert core.problems == ("certificate daemon: expires in 15 days",)
    renew(folder, "daemon", late)
    assert not core.look(late + timedelta(seconds=1)), "not all the time"
    assert core.look(late + timedelta(minutes=2))
    assert core.problems == ("the gate's certificate was renewed: restart the gate to use it",)


def test_visitors_are_counted_as_they_come_and_go(folder: CertificateFolder) -> None:
    core = GateCore(GateConfig(), folder)
    seen = [core.see(names) for names in ([], ["monitor"], ["monitor", "monitor"], ["monitor", "gateway"])]
    assert seen == [False, True, True, True]
    assert core.counts == {"arrivals": 3, "departures": 1}
    assert core.info() == {"visitors": 2, "visitor_names": "gateway, monitor"}


def test_a_daemon_of_the_cell_never_listens_beyond_loopback() -> None:
    for endpoint in ("tcp/0.0.0.0:7453", "tcp/192.168.0.4:7453", "tls/127.0.0.1:7453", "udp/127.0.0.1:7453"):
        with pytest.raises(ValidationError, match="loopback"):
            BusSection(endpoints={"fusion": endpoint})
    for endpoint in ("tcp/127.0.0.1:7453", "tcp/localhost:7453", "tcp/[::1]:7453", "unixsock-stream//run/x/f.sock"):
        assert BusSection(endpoints={"fusion": endpoint}).all_endpoints()["fusion"] == endpoint


def test_a_socket_folder_is_made_private_or_refused(tmp_path: Path) -> None:
    section = BusSection(socket_folder=str(tmp_path / "run"))
    section.prepare_socket_folder()
    section.prepare_socket_folder()
    (tmp_path / "run").chmod(0o711)
    with pytest.raises(ConfigError, match="open to others"):
        section.prepare_socket_folder()
    (tmp_path / "link").symlink_to(tmp_path)
    with pytest.raises(ConfigError, match="no folder"):
        BusSection(socket_folder=str(tmp_path / "link")).prepare_socket_folder()
