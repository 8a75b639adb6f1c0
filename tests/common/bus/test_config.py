"""Bus configurations: bounds, the mesh, and what zenoh is told."""

from __future__ import annotations

import json

import pytest
from pydantic import ValidationError

from motiondlo.bus.config import BusConfig
from motiondlo.bus.settings import zenoh_config
from motiondlo.errors import ConfigError

ENDPOINTS = {"a": "tcp/127.0.0.1:7001", "b": "tcp/127.0.0.1:7002", "c": "unixsock-stream//run/x/c"}


@pytest.mark.parametrize(
    "wrong",
    [
        {"cell": "a/b"},
        {"mode": "mesh"},
        {"lease_ms": 50},
        {"listen": ("7447",)},
        {"unknown": 1},
        {"shared_memory": "yes"},
    ],
)
def test_a_wrong_value_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        BusConfig.model_validate({"cell": "cell1", **wrong})


def test_endpoints_may_be_lists_as_files_have_them() -> None:
    config = BusConfig.model_validate({"cell": "cell1", "connect": ["tcp/127.0.0.1:7001"]})
    assert config.connect == ("tcp/127.0.0.1:7001",)


def test_in_a_mesh_every_pair_has_exactly_one_link() -> None:
    configs = {name: BusConfig.mesh("cell1", ENDPOINTS, name) for name in ENDPOINTS}
    links = [(name, endpoint) for name, config in configs.items() for endpoint in config.connect]
    assert sorted(links) == sorted([("b", ENDPOINTS["a"]), ("c", ENDPOINTS["a"]), ("c", ENDPOINTS["b"])])
    assert all(configs[name].listen == (ENDPOINTS[name],) for name in ENDPOINTS)


def test_a_daemon_without_an_endpoint_is_named() -> None:
    with pytest.raises(ConfigError, match="fusion"):
        BusConfig.mesh("cell1", ENDPOINTS, "fusion")


def test_nothing_is_discovered_and_a_lost_neighbour_is_noticed_within_a_second() -> None:
    settings = json.loads(str(zenoh_config(BusConfig.mesh("cell1", ENDPOINTS, "b"), shared_memory=False)))
    assert settings["scouting"]["multicast"]["enabled"] is False
    assert settings["scouting"]["gossip"]["enabled"] is False
    assert settings["transport"]["link"]["tx"]["lease"] <= 1000
    assert settings["transport"]["shared_memory"]["enabled"] is False
    assert settings["connect"]["endpoints"] == [ENDPOINTS["a"]]


def test_further_zenoh_settings_are_passed_on_and_wrong_ones_named() -> None:
    good = BusConfig(cell="cell1", zenoh={"transport/unicast/max_sessions": 7})
    assert json.loads(str(zenoh_config(good, False)))["transport"]["unicast"]["max_sessions"] == 7
    with pytest.raises(ConfigError, match="no/such/setting"):
        zenoh_config(BusConfig(cell="cell1", zenoh={"no/such/setting": 1}), False)
