"""Notification, latencies and endpoints."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from motiondlo.errors import ConfigError
from motiondlo_services.processes import PROCESSES
from motiondlo_services.runtime.bus_section import BusSection
from motiondlo_services.runtime.latency import LatencyWindow
from motiondlo_services.runtime.notify import Notifier


def test_the_manager_hears_what_it_is_told(tmp_path: Path) -> None:
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(path)
        manager.settimeout(1.0)
        notifier = Notifier(path)
        notifier.send("READY=1", "STATUS=fine")
        assert manager.recv(1000) == b"READY=1\nSTATUS=fine"
        notifier.close()
    assert notifier.lost == 0


def test_a_manager_that_does_not_listen_never_blocks_a_daemon(tmp_path: Path) -> None:
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(path)
        notifier = Notifier(path)
        for _ in range(5000):
            notifier.send("WATCHDOG=1")
        notifier.close()
    assert notifier.lost > 0


def test_without_a_manager_nothing_happens() -> None:
    notifier = Notifier("")
    notifier.send("READY=1")
    notifier.close()
    assert notifier.lost == 0


def test_latencies_are_summed_up_and_start_anew() -> None:
    window = LatencyWindow()
    assert window.take() is None
    for ms in range(1, 101):
        window.add(ms * 1_000_000)
    quantiles = window.take()
    assert quantiles is not None
    assert quantiles.p50 == pytest.approx(50.5)
    assert quantiles.max == 100.0
    assert window.take() is None


def test_every_pair_of_daemons_has_one_link() -> None:
    section = BusSection(first_port=20_000)
    configs = {row.name: section.of_daemon("cell1", row.name) for row in PROCESSES if row.in_mesh}
    listens = {name: config.listen[0] for name, config in configs.items()}
    assert len(set(listens.values())) == len(configs)
    links = {frozenset((listens[name], other)) for name, config in configs.items() for other in config.connect}
    assert len(links) == len(configs) * (len(configs) - 1) // 2
    assert sum(len(config.connect) for config in configs.values()) == len(links), "none twice"


def test_an_endpoint_of_its_own_is_known_to_all() -> None:
    section = BusSection(endpoints={"fusion": "tcp/127.0.0.1:9999"})
    assert section.of_daemon("c", "fusion").listen == ("tcp/127.0.0.1:9999",)
    assert "tcp/127.0.0.1:9999" in section.of_daemon("c", "segmenter").connect
    assert section.of_client("c", "fusion").connect == ("tcp/127.0.0.1:9999",)


def test_a_daemon_that_does_not_exist_has_no_session() -> None:
    with pytest.raises(ConfigError, match="nobody"):
        BusSection().of_daemon("c", "nobody")
