"""The published JSON Schemas are those of the files that are written."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import jsonschema
import pytest

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.conftest import ROOT

MADE = runpy.run_path(str(ROOT / "docs" / "generate_schema.py"))


@pytest.mark.parametrize("name", MADE["SCHEMAS"])
def test_the_page_has_the_schema(name: str) -> None:
    written = (ROOT / "docs" / f"{name}.schema.json").read_text(encoding="utf-8")
    assert written == MADE["text"](name), "python docs/generate_schema.py"


def test_a_twin_is_of_its_schema(tmp_path: Path) -> None:
    virtual = VirtualMachine.load(pt.machines()["emps"])
    log = virtual.record(random_trajectory(virtual, 10.0, 1), seed=1).to_log()
    content = json.loads(
        (pt.identify("emps", log, loop=False).save(tmp_path / "twin") / "twin.json").read_text()
    )
    check = jsonschema.Draft202012Validator(MADE["SCHEMAS"]["twin"]())
    assert not list(check.iter_errors(content))
    assert list(check.iter_errors(content | {"schema": "pinotwin.twin/0"}))
    assert list(check.iter_errors({k: x for k, x in content.items() if k != "theta"}))


def test_a_diagnosis_is_of_its_schema(tmp_path: Path) -> None:
    virtual = VirtualMachine.load(pt.machines()["emps"], inject=["viscous:X=0.2"])
    log = virtual.record(random_trajectory(virtual, 10.0, 1), seed=1).to_log()
    content = json.loads((pt.diagnose("emps", log, quick=True).save(tmp_path) / "diagnosis.json").read_text())
    check = jsonschema.Draft202012Validator(MADE["SCHEMAS"]["diagnosis"]())
    assert not list(check.iter_errors(content))
    assert list(check.iter_errors(content | {"schema": 0}))
    assert list(check.iter_errors(content | {"verdict": "well"}))
    assert list(check.iter_errors({k: x for k, x in content.items() if k != "verdict"}))
