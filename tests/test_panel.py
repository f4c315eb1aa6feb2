"""The viewer's page: sliders, plots, ghost and overlay from one tree, the same bytes in every run."""

from __future__ import annotations

import json
import re
import urllib.request
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.viewer.live import serve
from pinotwin.viewer.tracks import POINTS, tracks_of
from tests.rig import good_log, run, write_log, write_machine
from tests.simulated import known_twin, plain_machine, smooth_command


def data(page: str) -> dict:
    return json.loads(re.search(r"^const DATA = (.*);$", page, re.MULTILINE).group(1).replace("<\\/", "</"))


def moved(joint: dict, q: float) -> np.ndarray:
    """What panel.js does for one joint, in Python."""
    pose = np.eye(4)
    axis = np.array(joint["axis"])
    if joint["rotary"]:
        pose[:3, :3] = pin.exp3(axis * q)
    else:
        pose[:3, 3] = axis * q
    return pose


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    home = tmp_path_factory.mktemp("panel")
    twin = known_twin(plain_machine("trunnion"))
    twin.save(home / "twin")
    command = smooth_command(twin.machine, 4.0, 500.0)
    found = twin.simulate(command)
    channels = {"t": command.t}
    for axis in twin.machine.axes:
        channels |= {
            f"{axis}.qr": command[f"{axis}.qr"],
            f"{axis}.q": found[f"{axis}.q"],
            f"{axis}.u": found[f"{axis}.u"],
        }
    pt.Log(channels).to_pandas().to_csv(home / "log.csv", index=False)
    return home


def page_of(folder, *words: str) -> str:
    assert main(["view", *words, "--html", str(folder / "page.html")]) == 0
    return (folder / "page.html").read_text(encoding="utf-8")


def test_the_tree_in_the_page_is_the_machines(folder):
    found = data(page_of(folder, "laser_driller"))
    model = pt.Machine.load("laser_driller").model
    q = np.linspace(-0.2, 0.3, model.nv)
    placed = model.createData()
    pin.forwardKinematics(model, placed, q)
    world = []
    for k, joint in enumerate(found["bodies"][0]["joints"]):
        own = np.array(joint["place"]).reshape(4, 4).T @ moved(joint, q[joint["column"]])
        world.append(own if joint["parent"] < 0 else world[joint["parent"]] @ own)
        np.testing.assert_allclose(world[-1], placed.oMi[k + 1].homogeneous, atol=1e-12)


def test_sliders_keep_to_the_limits(folder):
    model = pt.Machine.load("trunnion").model
    axes = data(page_of(folder, "trunnion"))["axes"]
    assert len(axes) == 3
    for axis in axes:
        assert axis["low"] == model.lowerPositionLimit[axis["column"]]
        assert axis["high"] == model.upperPositionLimit[axis["column"]]
        assert axis["limited"]


def test_a_log_brings_plots_that_add_up(folder):
    found = data(page_of(folder, str(folder / "twin"), str(folder / "log.csv")))
    frames = found["frames"]
    assert len(frames["t"]) <= POINTS
    assert [body["root"] for body in found["bodies"]] == ["machine", "ghost"]
    for axis in found["axes"]:
        series = axis["series"]
        assert set(series) == {"effort", "gap", "error", "parts"}
        measured, model = (np.array(line["y"], float) for line in series["effort"])
        gap = np.array(series["gap"][0]["y"], float)
        known = np.isfinite(gap)
        assert known.mean() > 0.95
        np.testing.assert_allclose((measured - model)[known], gap[known], atol=2e-4 * np.abs(measured).max())
        error = np.array(series["error"][0]["y"], float) / (np.rad2deg(1e3) if axis["unit"] == "°" else 1e6)
        q, qr = (np.array(frames[k])[:, axis["column"]] for k in ("q", "qr"))
        np.testing.assert_allclose(qr - q, error, atol=1e-6)


def test_a_machine_alone_has_no_model_to_compare_with(folder):
    log = pt.read(folder / "log.csv")
    machine = pt.Machine.load("trunnion")
    tracks = tracks_of(machine, pt.prepare(machine, log))
    assert set(tracks.series["Y"]) == {"effort", "error"}


def test_two_runs_write_the_same_bytes(folder):
    words = (str(folder / "twin"), str(folder / "log.csv"))
    assert page_of(folder, *words) == page_of(folder, *words)


def test_overlay_follows_the_axes_by_name(folder):
    found = data(page_of(folder, "trunnion", "--overlay", str(folder / "twin")))
    bodies = {body["root"]: body["joints"] for body in found["bodies"]}
    assert [j["column"] for j in bodies["overlay"]] == [j["column"] for j in bodies["machine"]]
    assert any("overlaid" in layer["text"] for layer in found["layers"])


def test_legend_names_everything_that_can_be_shown(folder):
    texts = " ".join(
        layer["text"]
        for layer in data(page_of(folder, str(folder / "twin"), str(folder / "log.csv")))["layers"]
    )
    for word in ("names", "frames", "centres of mass", "inertia ellipsoids", "command", "residual"):
        assert word in texts


def test_page_loads_nothing(folder):
    page = page_of(folder, "emps")
    page = page.replace('<link rel="icon" href="data:,">', "")
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)\s*=", page)


def test_live_serves_the_page(folder):
    page = page_of(folder, "emps")
    with serve(page, open_browser=False) as url, urllib.request.urlopen(url, timeout=10) as answer:
        assert answer.read().decode() == page


def test_a_machine_plays_a_log_without_a_twin(tmp_path: Path) -> None:
    machine = write_machine(tmp_path / "rig")
    log = write_log(tmp_path / "log.csv", good_log())
    assert run("view", machine, log, "--html", tmp_path / "page.html") == 0
    assert "measured" in (tmp_path / "page.html").read_text(encoding="utf-8")
