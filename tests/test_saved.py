"""What results write and draw from Python: what the commands write, and figures of the pages."""

from __future__ import annotations

import base64
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest
from lxml import etree

import pinotwin as pt
from pinotwin.arrays import plain
from pinotwin.cli.main import main
from pinotwin.report.still import svg
from pinotwin.system.writing import write_json


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A drive's twin and a day with more friction."""
    out = tmp_path_factory.mktemp("saved")
    record = ["record", "emps", "--seconds", "8", "--out"]
    assert main([*record, str(out / "log.csv")]) == 0
    assert main([*record, str(out / "day.csv"), "--seed", "2", "--inject", "viscous:X=0.3"]) == 0
    pt.identify("emps", out / "log.csv", loop=False).save(out / "twin")
    return out


@pytest.fixture(scope="module")
def found(folder) -> pt.Diagnosis:
    return pt.diagnose(folder / "twin", str(folder / "day.csv"), quick=True, random_state=0)


def text(path: Path) -> str:
    """The text of a file without its date and the time taken."""
    if path.suffix != ".json":
        return path.read_text(encoding="utf-8")
    content = json.loads(path.read_text(encoding="utf-8"))
    for key in ("date", "seconds_taken"):
        content["provenance"].pop(key, None)
    return json.dumps(content)


def test_a_diagnosis_saves_what_the_command_writes(folder, found, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    assert main(["diagnose", "twin", "day.csv", "--quick", "--out", "by_command"]) == 0
    assert pt.diagnose("twin", "day.csv", quick=True).save("by_hand") == Path("by_hand")
    names = sorted(str(p.relative_to("by_command")) for p in Path("by_command").rglob("*") if p.is_file())
    assert names == sorted(str(p.relative_to("by_hand")) for p in Path("by_hand").rglob("*") if p.is_file())
    assert {"diagnosis.json", "report.html", "machine.html", "machine/machine.yaml"} <= set(names)
    for name in set(names) - {"report.html"}:
        assert text(Path("by_command", name)) == text(Path("by_hand", name)), name
    assert "20" in json.loads(Path("by_hand/diagnosis.json").read_text())["provenance"]["date"]


def test_a_saved_diagnosis_replaces_an_earlier_one(found, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "advice_old.csv").write_text("t\n0\n")
    found.save(tmp_path / "out")
    assert not (tmp_path / "out" / "advice_old.csv").exists()


def test_the_page_alone(found, tmp_path):
    page = found.report(tmp_path / "page.html").read_text(encoding="utf-8")
    assert "viscous friction on axis X" in page
    assert "day.csv" in page


def test_causes_and_the_machine_with_them(found, tmp_path):
    assert [(c.effect, c.axis) for c in found.causes] == [("viscous", "X")]
    assert found.repaired().name == "emps"
    found.apply(tmp_path / "applied")
    applied = pt.Machine.load(tmp_path / "applied")
    assert applied.axes["X"].effects == found.repaired().axes["X"].effects


def image(result: object) -> str:
    """The still in a result's HTML, as SVG text."""
    (data,) = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', result._repr_html_())
    text = base64.b64decode(data).decode()
    etree.fromstring(text)
    return text


def test_a_diagnosis_draws_its_residual(found):
    figure = found.plot()
    trace = next(t for t in found.traces if t.axis == "X")
    names = [line.name for line in figure.data]
    assert names == ["without the cause", "with the cause"]
    assert np.nanmax(np.abs(figure.data[0].y)) == pytest.approx(np.max(np.abs(trace.before)), rel=1e-4)
    assert "var(" not in figure.to_json()
    assert image(found).count('id="trace-') == 2
    assert found.plot("X").to_json() == figure.to_json()
    with pytest.raises(pt.InputError, match="nothing to draw of Q"):
        found.plot("Q")


def test_a_twin_draws_its_own_logs_and_others(folder, tmp_path):
    twin = pt.Twin.load(folder / "twin")
    own, other = twin.plot(), twin.plot(folder / "day.csv")
    assert {line.name for line in own.data} >= {"measured", "predicted", "residual"}
    assert own.to_json() != other.to_json()
    assert "residual" in image(twin)
    page = twin.report(tmp_path / "twin.html", folder / "log.csv").read_text(encoding="utf-8")
    assert "emps: identification" in page
    with pytest.raises(pt.InputError, match="needs the log"):
        twin.report(tmp_path / "twin.html")
    with pytest.raises(pt.InputError, match="a page is written as"):
        twin.report(tmp_path / "twin.txt", folder / "log.csv")


def test_a_prediction_draws_writes_and_judges_itself(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    if not (folder / "whole").exists():
        pt.identify("emps", "log.csv").save("whole")
    predicted = pt.Twin.load("whole").simulate("day.csv")
    assert main(["simulate", "whole", "day.csv", "--out", "p.csv", "--json", "p.json"]) == 0
    assert predicted.save(tmp_path / "p.csv").read_text() == Path("p.csv").read_text()
    said = json.loads(Path("p.json").read_text())
    assert said["controller"] == predicted.controller
    assert said["axes"]["X"]["u"]["nrmse"] == pytest.approx(predicted.errors["X"]["u"]["nrmse"])
    assert [line.name for line in predicted.plot().data] == ["measured", "predicted"] * 2
    assert image(predicted).count('id="trace-') == 4
    assert "emps: simulation" in predicted.report(tmp_path / "p.html").read_text(encoding="utf-8")


def test_a_still_keeps_the_extremes_and_breaks():
    y = np.zeros(5000)
    y[1234] = 7.0
    y[3000:3200] = np.nan
    figure = go.Figure(go.Scatter(x=np.arange(5000), y=y, line={"color": "#123456"}))
    text = svg(figure)
    (path,) = re.findall(r'id="trace-y-0">\s*<path d="(M[^"]+)"', text)
    assert path.count("M") == 2
    heights = [float(h) for h in re.findall(r"[ML] [\d.]+ ([\d.]+)", path)]
    assert max(heights) - min(heights) == pytest.approx(0.75 * (300 - 72) / 1.1, rel=0.01)
    assert len(heights) < 1600
    assert ">7<" in text


COMMANDS = [
    "check",
    "identify",
    "simulate",
    "diagnose",
    "force",
    "compare",
    "vibration",
    "export",
    "record",
    "study",
]


def test_every_command_is_a_function_of_its_name():
    code = (
        f"import pinotwin as pt; [getattr(pt, n) for n in {COMMANDS}]; assert callable(pt.export), pt.export"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    for name in COMMANDS:
        assert callable(getattr(pt, name)), name


def same(by_hand: dict[str, object], by_command: str) -> None:
    """Whether a result says what the command's JSON says."""
    said = json.loads(Path(by_command).read_text())
    assert json.loads(json.dumps(plain(by_hand))) == said


def test_force_and_export(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    found = pt.force("twin", "day.csv")
    assert main(["force", "twin", "day.csv", "--out", "f.csv", "--json", "f.json"]) == 0
    same(found.to_dict(), "f.json")
    assert found.save(tmp_path / "f.csv").read_text() == Path("f.csv").read_text()
    made = pt.export("twin", "urdf", "arm.urdf")
    assert main(["export", "twin", "--format", "urdf", "--out", "arm.urdf", "--json", "x.json"]) == 0
    same(made.to_dict(), "x.json")


def test_record_is_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["--seconds", "2", "--seed", "3", "--inject", "viscous:X=0.3", "--withhold", "coulomb"]
    assert main(["record", "emps", *words, "--out", "r.csv", "--json", "r.json"]) == 0
    log = pt.record("emps", seconds=2.0, seed=3, inject=["viscous:X=0.3"], withhold=["coulomb"])
    same(log.to_dict(), "r.json")
    assert log.save("again.csv").read_text() == Path("r.csv").read_text()
    repeat = pt.record("emps", seed=4, command=log)
    np.testing.assert_allclose(repeat["X.qr"], log["X.qr"][: len(repeat)])
    with pytest.raises(pt.InputError, match="no kind 'randm'; did you mean 'random'"):
        pt.record("emps", trajectory="randm")


def test_compare_takes_twins_or_diagnoses(folder, found, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    other = pt.identify("emps", "day.csv", loop=False)
    moved = pt.compare("twin", other, labels=("before", "after"), log="day.csv")
    assert "X.viscous.b" in {row.name for row in moved.moved}
    moved.save(tmp_path / "twins")
    assert json.loads((tmp_path / "twins/compare.json").read_text())["labels"] == ["before", "after"]
    both = pt.compare(found, found)
    assert list(both.causes) == [("viscous", "X")]
    assert (both.save(tmp_path / "both") / "compare.html").is_file()
    with pytest.raises(pt.InputError, match="twins or diagnoses, not both"):
        pt.compare(other, found)


def test_study_saves_its_tables(folder, tmp_path):
    found = pt.study(folder / "twin", folder / "log.csv", only=["without"])
    found.save(tmp_path / "s")
    assert {p.name for p in (tmp_path / "s").iterdir()} >= {"study.html", *found.to_dict()["tables"]}
    with pytest.raises(pt.InputError, match="no study 'amont'; did you mean 'amount'"):
        pt.study(folder / "twin", folder / "log.csv", only=["amont"])


def test_json_has_no_word_for_infinity(tmp_path):
    write_json(tmp_path / "x.json", {"a": np.inf, "b": np.arange(2)})
    assert json.loads((tmp_path / "x.json").read_text()) == {"a": None, "b": [0, 1]}
