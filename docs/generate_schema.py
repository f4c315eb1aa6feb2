"""Write the JSON Schemas in docs from what reads and writes the files; ``make docs`` runs it, a test holds it true."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, get_args

import msgspec

from pinotwin.diagnosis.result import Diagnosis, Verdict
from pinotwin.effects import EFFECTS
from pinotwin.machine.effect_list import types_of
from pinotwin.machine.loading import REQUIRED, MachineFile
from pinotwin.system.reading import schema
from pinotwin.twin.files import SCHEMA as TWIN_SCHEMA
from pinotwin.twin.files import Document as TwinDocument

KINDS: dict[type, str] = {str: "string", bool: "boolean", int: "integer", list: "array", dict: "object"}
"""Type of a value -> its name in a schema."""


def machine_schema() -> dict[str, Any]:
    """Return the JSON Schema of machine.yaml, for editors that complete and check it."""
    out: dict[str, Any] = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "machine.yaml of pinotwin",
    }
    out |= schema(MachineFile) | {"required": list(REQUIRED)}
    out["properties"]["axes"]["additionalProperties"]["properties"]["effects"]["items"] = effect_schema()
    return out


def effect_schema() -> dict[str, Any]:
    """Return the JSON Schema of an item of such a list: a name, one name with its settings, or an own effect's."""
    listed = {name: cls for name, cls in EFFECTS.items() if not cls.unlisted}
    settings = {
        name: {
            "properties": {k: schema(one) for k, one in types_of(cls).items()},
            "additionalProperties": False,
        }
        for name, cls in listed.items()
    }
    own = {"type": "string", "pattern": ":"}
    return {"anyOf": [{"enum": list(listed)}, own, {"type": "object", "properties": settings}]}


def diagnosis_schema() -> dict[str, Any]:
    """Return the JSON Schema of diagnosis.json: its keys and what each is; keys are only ever added."""
    rest: dict[str, Any] = {key: {} for key in ("gap", "unexplained", "remains", "shrink")}
    empty = Diagnosis(
        sentence="",
        where=(),
        effects=(),
        confusable=(),
        noise="assumed",
        advice=(),
        situation="change",
        **rest,
    ).to_dict()
    keys: dict[str, Any] = {key: {"type": KINDS[type(x)]} for key, x in empty.items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "diagnosis.json of pinotwin",
        "type": "object",
        "properties": keys | {"schema": {"const": empty["schema"]}, "verdict": {"enum": get_args(Verdict)}},
        "required": list(keys),
    }


def twin_schema() -> dict[str, Any]:
    """Return the JSON Schema of twin.json."""
    out = msgspec.json.schema(TwinDocument)
    body = out["$defs"][TwinDocument.__name__]
    body |= {"title": "twin.json of pinotwin", "required": ["schema", *body["required"]]}
    body["properties"]["schema"] = {"const": TWIN_SCHEMA}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **out}


SCHEMAS = {"machine": machine_schema, "twin": twin_schema, "diagnosis": diagnosis_schema}


def text(name: str) -> str:
    """Return the text of a schema in docs."""
    return json.dumps(SCHEMAS[name](), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for name in SCHEMAS:
        (Path(__file__).parent / f"{name}.schema.json").write_text(text(name), encoding="utf-8")
