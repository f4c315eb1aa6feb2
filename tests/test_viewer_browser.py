"""What a real browser draws: every triangle of every file in its colour, the machine whole, and without WebGL."""

from __future__ import annotations

import html
import json
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import coal
import numpy as np
import pytest

from pinotwin.errors import MachineError
from pinotwin.machine import Machine
from pinotwin.machine.bundled import robots
from pinotwin.viewer import View, view, visual_model
from pinotwin.viewer.meshes import Part, parts_of
from tests.screenshot import browser, dom

pytestmark = pytest.mark.skipif(browser() is None, reason="no Chromium on this computer")
CASES = Path(__file__).resolve().parents[2] / "shared" / "cases" / "viewer"
ROBOTS = sorted({path: name for name, path in robots().items()}.values())
BASE = "e6e6e6"  # of what the URDF gives no colour
SIZES = [(1200, 800), (1400, 900), (500, 800), (1920, 1080)]
SEEN = """<script>(function ask() {
  if (!document.body.dataset.triangles) return setTimeout(ask, 20);
  const all = [], place = new MeshCat.THREE.Vector3();
  viewer.render();
  viewer.scene_tree.find(["meshcat", "machine"]).object.traverse((o) => {
    if (!o.isMesh || !/Buffer/.test(o.geometry.type)) return;
    const at = o.geometry.attributes.position;
    for (let k = 0; k < at.count; k++) {
      place.fromBufferAttribute(at, k).applyMatrix4(o.matrixWorld).project(viewer.camera);
      all.push(place.x, place.y);
    }
  });
  const of = (k) => all.filter((_, i) => i % 2 == k), pane = document.getElementById("pane").getBoundingClientRect();
  const put = document.createElement("pre");
  put.id = "seen";
  const ends = [0, 1].map((k) => of(k).reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [9, -9]));
  put.textContent = JSON.stringify({ ends, pane: [pane.left, pane.right, pane.top, pane.bottom], wide: innerWidth });
  document.body.appendChild(put);
})()</script>"""


def drawn(text: str) -> tuple[int, dict[str, int]]:
    """Return how many triangles a page drew of its machine, and how many of each colour."""
    found = re.search(r'<body[^>]*data-triangles="(\d+)"[^>]*data-colours="([^"]*)"', text)
    assert found, "the page did not come to its end"
    return int(found[1]), json.loads(html.unescape(found[2]))


def colours(machine: Machine) -> dict[str, int]:
    """Return the triangles of each colour that the files of a machine hold."""
    count: Counter[str] = Counter()
    for shape in visual_model(machine.model, machine.urdf, machine.meshes).geometryObjects:
        for part in parts_of(shape):
            count["".join(f"{round(255 * x):02x}" for x in (part.rgba or ())[:3])] += len(part.faces)
    return dict(count)


def whole(part: Part) -> int:
    """Return the triangles with three different corners."""
    a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
    return int(((a != b).any(1) & (b != c).any(1) & (c != a).any(1)).sum())


def check(found: View, path: Path, machine: Machine) -> None:
    text, console = dom(found.save(path).as_uri())
    assert console == []
    triangles, by_colour = drawn(text)
    assert by_colour == colours(machine)
    assert triangles == sum(by_colour.values()) > 0


@pytest.mark.parametrize("name", ["two_bodies", "two_colours"])
def test_every_body_and_colour_of_a_collada_file(tmp_path: Path, name: str) -> None:
    if not CASES.is_dir():
        pytest.skip("the shared cases are not at hand")
    machine = Machine.load(CASES / f"{name}.urdf")
    text, console = dom(view(machine).save(tmp_path / "page.html").as_uri())
    blue = {"0d1ae6"} if name == "two_bodies" else set()
    assert set(drawn(text)[1]) - {BASE} == {"e60d0d", "0dcc0d"} | blue
    assert drawn(text)[1] == colours(machine)
    assert console == []


@pytest.mark.skipif("ur5_robot" not in robots(), reason="example-robot-data is not installed")
def test_ur5_is_drawn_whole_live_and_as_a_page(tmp_path: Path) -> None:
    machine = Machine.load("ur5_robot")
    check(view(machine), tmp_path / "page.html", machine)
    command = [sys.executable, "-c", LIVE, "view", "ur5_robot"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as live:
        assert live.stdout is not None
        try:
            url = next(word for line in live.stdout for word in re.findall(r"http://127\S+/", line))
            text, console = dom(url)
        finally:
            live.terminate()
    assert drawn(text)[1] == colours(machine)
    assert console == []


LIVE = """
import sys, webbrowser
webbrowser.open = lambda url: True
from pinotwin.cli.main import main
main(sys.argv[1:])
"""


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A page that says where what it drew lies, at the edges of the picture -1 and 1."""
    name = "ur5_robot" if "ur5_robot" in robots() else "trunnion"
    path = tmp_path_factory.mktemp("seen") / "page.html"
    path.write_text(view(name, frames=False).page.replace("</body>", SEEN + "</body>"), encoding="utf-8")
    return path.as_uri()


@pytest.mark.parametrize("size", SIZES)
def test_the_first_picture_holds_the_whole_machine(measured: str, size: tuple[int, int]) -> None:
    text, _ = dom(measured, size=size)
    (told,) = re.findall(r'<pre id="seen">(.*?)</pre>', text)
    found = json.loads(told)
    ends = np.abs(found["ends"])
    assert 0.8 < ends.max() <= 1.0
    left, right, top, _ = found["pane"]
    assert left >= 0 <= top
    assert right <= found["wide"] - (300 if size[0] > 760 else 0)


def test_without_webgl_a_still_picture_and_no_exception(tmp_path: Path) -> None:
    text, console = dom(view("trunnion").save(tmp_path / "page.html").as_uri(), "--disable-3d-apis")
    assert console == []
    assert re.search(r'<img id="still" alt=""\s+src="data:image/png;base64,\w', text)
    assert "has no WebGL" in text


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_is_drawn_as_its_files_say(tmp_path: Path, name: str) -> None:
    """Against the browser, and the files against Pinocchio's reader, which drops triangles without a surface."""
    try:
        machine = Machine.load(name)
    except MachineError as error:
        pytest.skip(str(error))  # a robot without an axis
    for shape in visual_model(machine.model, machine.urdf).geometryObjects:
        if isinstance(shape.geometry, coal.BVHModelBase):
            found = parts_of(shape)
            assert sum(whole(part) for part in found) == shape.geometry.num_tris
            used = np.concatenate([part.vertices[np.unique(part.faces)] for part in found])
            other = np.asarray(shape.geometry.vertices())
            size = np.ptp(other, axis=0).max()
            for end in (np.min, np.max):
                np.testing.assert_allclose(end(used, axis=0), end(other, axis=0), atol=1e-5 * size)
    check(view(machine), tmp_path / "page.html", machine)
