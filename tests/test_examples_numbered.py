"""Examples 01 to 10 and the notebook run, and say what the docs say of them."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

import pinotwin as pt
from pinotwin.machine.bundled import robots
from tests.conftest import ROOT

EXAMPLES = ROOT / "examples"


def run(name: str, **options: object) -> object:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.main(**options)


def test_there_are_ten_and_each_fits_on_two_screens() -> None:
    numbered = sorted(EXAMPLES.glob("[01][0-9]_*.py"))
    assert [int(path.name[:2]) for path in numbered] == list(range(1, 11))
    for path in numbered:
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 110, path.name
        assert "You see " in text.split('"""')[1], f"{path.name}: its first comment says what is seen"


def test_01_a_vendors_file() -> None:
    guessed = run("01_vendor_file", seconds=6.0)
    assert guessed == {"t": "Zeit", "X.qr": "s soll X", "X.q": "s ist X", "X.u": "I X"}


def test_02_check() -> None:
    known, said = run("02_check", seconds=6.0)
    assert known >= 9
    assert any("looks like mm" in text for text in said)


def test_03_identify_and_predict() -> None:
    errors = run("03_identify_and_predict", seconds=10.0)
    assert errors["e"] < 0.02
    assert errors["u"] < 0.12


@pytest.mark.parametrize(("name", "joints"), [("04_ur10_from_a_ros_bag", 6), ("05_panda", 7)])
def test_04_05_robots_from_bags(name: str, joints: int) -> None:
    """From a bag by new, check, identify, diagnose and export: the joint that rubs three times as much."""
    if not {"ur10", "panda"} <= set(robots()):
        pytest.skip("example-robot-data is not installed")
    errors, found = run(name, seconds=12.0)
    assert len(errors) == joints
    assert (
        len(found.effects) == 1
    )  # a slow turn is no push: the model's friction turns more slowly than the robot's
    worn = found.effects[0]
    assert (worn.effect, worn.axis) == ("coulomb", list(errors)[joints // 2])
    assert worn.size[0].after / worn.size[0].before == pytest.approx(3.0, rel=0.1)
    assert max(errors.values()) < 0.12
    assert min(errors.values()) < 0.02


def test_06_a_fault_is_diagnosed(capsys: pytest.CaptureFixture[str]) -> None:
    found = run("06_diagnose_a_fault", seconds=10.0)
    assert (found.effects[0].effect, found.effects[0].axis) == ("viscous", "X")
    assert "residual" in capsys.readouterr().out


def test_07_what_dry_friction_is_worth() -> None:
    complete, without = run("07_withhold_an_effect", seconds=8.0)
    assert without > 2.0 * complete


def test_08_the_file_is_the_twin() -> None:
    assert run("08_leave_the_tool", seconds=8.0) < 0.01


def test_09_modes() -> None:
    found = run("09_modes")
    assert found["held"] == pytest.approx(20.0, rel=0.1)  # measured by the source with the motors held
    assert found["free"] > found["held"]


def test_10_tracking_error_by_cause() -> None:
    parts = run("10_tracking_error_by_cause", seconds=8.0)
    assert len(parts) >= 3
    assert all(size >= 0.0 for size in parts.values())
    assert max(parts.values()) > 1e-6


def run_notebook(name: str, folder: Path) -> str:
    """Run a notebook of the examples and return what it prints and shows."""
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(cells) <= 12
    assert any("image/svg" in str(cell.outputs) for cell in cells), "saved with its pictures"
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(folder)}}).execute()
    outputs = [out for cell in cells for out in cell.outputs]
    return "\n".join(out.get("text") or out.get("data", {}).get("text/plain", "") for out in outputs)


def test_a_withheld_effect_is_named_and_added_again(tmp_path: Path) -> None:
    text = run_notebook("drive.ipynb", tmp_path)
    size = float(text.split("root_drag on X: ")[1].split()[0])
    assert size == pytest.approx(60.0, rel=0.1)
    without, better = (
        float(text.split(f"\n{name} ")[1].split()[0]) for name in ("without", "with root drag")
    )
    assert better < 0.6 * without


@pytest.mark.skipif(not hasattr(pt.Log, "from_arrays"), reason="needs Log.from_arrays")
def test_arrays_of_a_robot_become_a_twin(tmp_path: Path) -> None:
    text = run_notebook("robot.ipynb", tmp_path)
    found = [
        float(line.split(" viscous ")[1].split()[0]) for line in text.splitlines() if " viscous " in line
    ]
    assert found == pytest.approx([2.0] * 6, rel=0.02)
    left = [
        float(line.split("residual ")[1].split()[0]) for line in text.splitlines() if " residual " in line
    ]
    assert len(left) == 6
    assert max(left) < 0.2
