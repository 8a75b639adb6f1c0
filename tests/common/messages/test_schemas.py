"""The checked-in JSON Schemas are current, and real messages satisfy them."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import msgpack
import pytest
from tests.common.messages.examples import STAMP, all_messages

from motiondlo.messages.schemas import MODELS, as_json, export, json_schema

CHECKED_IN = Path(__file__).resolve().parents[3] / "docs" / "schemas"


def test_the_checked_in_schemas_are_current(tmp_path: Path) -> None:
    fresh = {path.name: path.read_text() for path in export(tmp_path)}
    found = {path.name: path.read_text() for path in CHECKED_IN.glob("*.json")}
    assert fresh == found, "run: python -m motiondlo.messages.schemas docs/schemas"


@pytest.mark.parametrize("name", sorted(MODELS))
def test_a_real_message_satisfies_its_schema(name: str) -> None:
    schema = json_schema(name)
    jsonschema.Draft202012Validator.check_schema(schema)
    shown = as_json(msgpack.unpackb(all_messages()[name].to_bytes(STAMP)))
    jsonschema.validate(json.loads(json.dumps(shown)), schema)
    assert set(schema["required"]) <= set(shown)
    assert set(schema["properties"]) <= set(shown)


@pytest.mark.parametrize("name", sorted(MODELS))
def test_a_schema_refuses_a_message_without_its_header(name: str) -> None:
    shown = as_json(msgpack.unpackb(all_messages()[name].to_bytes(STAMP)))
    del shown["seq"]
    with pytest.raises(jsonschema.ValidationError, match="seq"):
        jsonschema.validate(shown, json_schema(name))


def test_a_schema_refuses_an_array_of_another_type() -> None:
    shown = as_json(msgpack.unpackb(all_messages()["state"].to_bytes(STAMP)))
    shown["dlos"][0]["nodes"]["dtype"] = "<f8"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(shown, json_schema("state"))
