"""Write docs/machine.schema.json from what reads machine.yaml; ``make docs`` runs it, a test holds it true."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pinotwin.effects import EFFECTS
from pinotwin.machine.effect_list import types_of
from pinotwin.machine.loading import REQUIRED, MachineFile
from pinotwin.system.reading import schema


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


def text() -> str:
    """Return the text of docs/machine.schema.json."""
    return json.dumps(machine_schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    (Path(__file__).parent / "machine.schema.json").write_text(text(), encoding="utf-8")
