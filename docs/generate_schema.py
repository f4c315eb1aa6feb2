"""Write docs/machine.schema.json from what reads machine.yaml; ``make docs`` runs it, a test holds it true."""

from __future__ import annotations

import json
from pathlib import Path

from pinotwin.machine.loading import machine_schema


def text() -> str:
    """Return the text of docs/machine.schema.json."""
    return json.dumps(machine_schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    (Path(__file__).parent / "machine.schema.json").write_text(text(), encoding="utf-8")
