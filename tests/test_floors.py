"""The floors: a module imports only from lower ones, so that every part can be read without the rest."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.conftest import FIRST, ROOT

PACKAGE = ROOT / "pinotwin"

# Part of the package -> floor. A part may import from lower floors only, and from itself.
FLOORS = {
    "errors": 0,
    "arrays": 0,
    "version": 0,
    "notebook": 0,
    "units": 1,
    "system": 1,
    "signals": 1,
    "log": 2,
    "motion": 2,
    "dynamics": 2,
    "trajectories": 2,
    "effects": 3,
    "solve": 3,
    "virtual": 3,
    "logs.settings": 2,
    "logs.files": 3,
    "columns": 3,
    "logs.write": 3,
    "logs.clock": 3,
    "loop": 4,
    "imu": 4,
    "logs.quality": 4,
    "machine": 4,
    "virtual.record": 5,
    "logs.channels": 5,
    "logs.prepare": 6,
    "logs": 6,
    "logs.plausible": 7,
    "twin": 7,
    "logs.prepared": 8,
    "logs.check": 9,
    "scaffold": 8,
    "simulation": 8,
    "analysis.disturbance": 8,
    "analysis": 9,
    "identification": 10,
    "diagnosis": 11,
    "reconstruction": 11,
    "studies": 11,
    "studies.improvement": 12,
    "viewer": 12,
    "export": 12,
    "report": 13,
    "bench": 14,
    "cli": 15,
}

# Imports upward, made inside a function when it is called: a method that is only a door to a verb.
# A method beside its result is easier to find than a function in another package.
DOORS = {
    ("twin", "simulation"): "Twin.simulate",
}

# The virtual machines stand for reality: what judges reality must not know how they are made.
SEES_VIRTUAL = {"virtual", "virtual.record", "bench", "cli"}

# Slow to import, and only for looking at results.
PLOTTING = {"plotly", "meshcat", "matplotlib", "IPython"}


@dataclass(frozen=True)
class Import:
    """One import: by whom, of what, and whether it happens when the module is loaded."""

    source: str
    target: str
    at_load: bool

    def __str__(self) -> str:
        return f"{self.source} imports {self.target}"


def modules() -> Iterator[tuple[str, Path]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        yield name.removesuffix(".__init__"), path


def imports(name: str, path: Path) -> Iterator[Import]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    yield from _walk(name, tree.body, at_load=True)


def _walk(name: str, body: list[ast.stmt], *, at_load: bool) -> Iterator[Import]:
    for node in body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            yield from _walk(name, node.body, at_load=False)  # never executed, but a dependency all the same
            continue
        if isinstance(node, ast.Import):
            yield from (Import(name, alias.name, at_load) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import"
            target = str(node.module)
            inner = {f"{target}.{alias.name}" for alias in node.names}
            found = sorted(inner & NAMES) or [target]
            yield from (Import(name, module, at_load) for module in found)
        deeper = at_load and not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for field in ("body", "orelse", "finalbody", "handlers"):
            for child in getattr(node, field, []) or []:
                inside = child.body if isinstance(child, ast.ExceptHandler) else [child]
                yield from _walk(name, inside, at_load=deeper)


NAMES = {name for name, _ in modules()}
IMPORTS = [one for name, path in modules() for one in imports(name, path)]
OWN = [one for one in IMPORTS if one.target.partition(".")[0] == "pinotwin"]


def part(module: str) -> str:
    """Return the part of the package that a module is in; "" for the package itself."""
    _, *inner = [*module.split("."), "", ""]
    two = ".".join(inner[:2])
    return two if two in FLOORS else inner[0]


def test_every_part_has_a_floor() -> None:
    assert {part(name) for name in NAMES} - {""} - set(FLOORS) == set()


def test_the_page_of_the_architecture_has_every_part() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ")]
    missing = [name for name in FLOORS if not any(f"`{name.replace('.', '/')}`" in row for row in rows)]
    assert set(missing) <= {"logs"}


def test_imports_go_down() -> None:
    wrong = [
        str(one)
        for one in OWN
        if part(one.source) not in ("", part(one.target))
        and part(one.target)
        and FLOORS[part(one.target)] >= FLOORS[part(one.source)]
        and (one.at_load or (part(one.source), part(one.target)) not in DOORS)
    ]
    assert wrong == []


def test_no_door_is_left_open_for_nothing() -> None:
    used = {(part(one.source), part(one.target)) for one in OWN if not one.at_load}
    assert set(DOORS) <= used


def test_the_package_itself_imports_nothing_of_its_own() -> None:
    assert [str(one) for one in OWN if one.source == "pinotwin" and one.at_load] == []


def test_no_import_cycles_between_modules() -> None:
    graph: dict[str, set[str]] = {name: set() for name in NAMES}
    for one in OWN:
        target = one.target if one.target in NAMES else one.target.rpartition(".")[0]
        if one.at_load and target != one.source:
            graph[one.source].add(target)
    done: set[str] = set()
    way: list[str] = []

    def visit(name: str) -> None:
        assert name not in way, " -> ".join([*way[way.index(name) :], name])
        if name in done:
            return
        way.append(name)
        for target in sorted(graph[name]):
            # `from pinotwin.machine.machine import Axis` inside pinotwin.machine runs its __init__
            # first, which is being run already: not a cycle, as long as it names the module.
            if not name.startswith(target + "."):
                visit(target)
        way.pop()
        done.add(name)

    for name in sorted(graph):
        visit(name)


# Modules that import one another, be it inside a function or for the type checker only.
CIRCLES = {
    "the one door: Machine.load, .from_model and .save": {
        "machine.from_model",
        "machine.loading",
        "machine.machine",
    },
    "known: Twin's verbs stand on Twin": {
        "simulation",
        "simulation.prediction",
        "simulation.run",
        "twin",
        "twin.files",
        "twin.twin",
    },
    "known: Diagnosis.apply": {"diagnosis.apply", "diagnosis.result"},
}


def test_no_circles_but_those_listed() -> None:
    known = [{f"pinotwin.{name}" for name in circle} for circle in CIRCLES.values()]
    new = [circle for circle in _circles() if not any(circle <= one for one in known)]
    assert new == []


def test_no_circle_is_listed_that_is_gone() -> None:
    found = _circles()
    smaller = [why for why, names in CIRCLES.items() if {f"pinotwin.{name}" for name in names} not in found]
    assert smaller == [], "take off the list what is out of the circle"


def _circles() -> list[set[str]]:
    """Return the sets of modules that import one another in circles, whenever and why ever they import."""
    graph = {name: _all_imports(name, path) for name, path in modules() if name != "pinotwin"}
    reach = {name: _reachable(name, graph) for name in graph}
    circles = [
        {other for other in reach[name] if name in reach[other]} for name in graph if name in reach[name]
    ]
    return [circle for k, circle in enumerate(circles) if circle not in circles[:k]]


def _all_imports(name: str, path: Path) -> set[str]:
    out: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            out |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            out |= ({f"{node.module}.{alias.name}" for alias in node.names} & NAMES) or {str(node.module)}
    # a package is being imported while its modules are: naming it is no circle
    return {target for target in out & NAMES if target != name and not name.startswith(target + ".")}


def _reachable(name: str, graph: dict[str, set[str]]) -> set[str]:
    out: set[str] = set()
    todo = [name]
    while todo:
        for target in graph.get(todo.pop(), set()) - out:
            out.add(target)
            todo.append(target)
    return out


def test_only_the_bench_and_the_command_line_know_the_virtual_machines() -> None:
    wrong = [
        str(one) for one in OWN if part(one.target) == "virtual" and part(one.source) not in SEES_VIRTUAL
    ]
    assert wrong == []


def test_plotting_stays_in_report_and_viewer() -> None:
    wrong = [
        str(one)
        for one in IMPORTS
        if one.target.partition(".")[0] in PLOTTING and part(one.source) not in ("report", "viewer")
    ]
    assert wrong == []


HEAVY = (
    "numba",
    "pinocchio",
    "scipy",
    "plotly",
    "meshcat",
    "control",
    "matplotlib",
    "pyarrow",
    "h5py",
    "mcap",
    "yourdfpy",
    "rich",
    "numpy",
    "yaml",
)


def loaded_by(code: str) -> set[str]:
    """Return which heavy libraries a fresh process has loaded after running ``code``."""
    program = f"{code}\nimport sys\nprint(*[m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120
    )
    return set(done.stdout.split())


def test_importing_the_package_loads_no_library() -> None:
    assert loaded_by("import pinotwin") == set()


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("from pinotwin.cli.main import COMMANDS", set(HEAVY)),
        ("import pinotwin as pt; pt.machines()", {"plotly", "meshcat", "control", "matplotlib"}),
        ("import pinotwin as pt; pt.read, pt.Log", {"plotly", "meshcat", "control", "matplotlib"}),
        (
            "import pinotwin as pt; pt.check, pt.Machine.load('trunnion')",
            {"plotly", "meshcat", "control", "matplotlib"},
        ),
        ("import pinotwin as pt; pt.identify", {"plotly", "meshcat", "matplotlib"}),
    ],
)
def test_what_is_used_loads_no_more_than_it_needs(code: str, absent: set[str]) -> None:
    assert loaded_by(code) & absent == set()


def test_help_needs_no_library() -> None:
    code = "import sys\nfrom pinotwin.cli.main import main\n"
    code += "import contextlib, io\nwith contextlib.redirect_stdout(io.StringIO()):\n"
    code += "    try:\n        main(['--help'])\n    except SystemExit:\n        pass"
    assert loaded_by(code) == set()


def test_files_that_the_suite_starts_with_are_there() -> None:
    assert [name for name in FIRST if not (ROOT / "tests" / f"{name}.py").is_file()] == []


def test_the_root_holds_at_most_nine_files() -> None:
    assert len(list(PACKAGE.glob("*.py"))) <= 9
