"""``pinotwin blind --machines emps --cases 4 --quick --out bench``: the withheld-effect bench, scored."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pinotwin.cli.arguments import Answer, Folder, Several
from pinotwin.cli.progress import progress
from pinotwin.errors import InputError
from pinotwin.system.writing import write_json, write_text

Situations = Annotated[Sequence[Literal["structure", "change"]], "+"]


def run(
    *,
    machines: Several | None = None,
    seeds: int = 1,
    cases: int | None = None,
    situations: Situations = ("structure", "change"),
    seconds: float = 8.0,
    workers: int = 2,
    limit_minutes: float | None = None,
    seed: int = 0,
    quick: bool = False,
    out: Folder,
) -> Answer:
    """Run the bench and write its table.

    Args:
        machines (NAME): bundled machines, random:SEED, or folders with a virtual.yaml
        seeds (N): rounds of about 95 cases each (1); the published table has 4
        cases (N): only so many of them, evenly spread
        situations: which of the two to run
        seconds: length of every log [s] (8)
        workers: processes (2)
        limit_minutes (T): begin no case after so long; the next run goes on from there
        seed: of everything that is drawn (0)
        quick: screen only, in every diagnosis
        out (PATH): folder for bench.html, bench.md, bench.json and cases.jsonl
    """
    from pinotwin.bench.cases import MACHINES, draw_cases, some
    from pinotwin.bench.run import Plan, run_bench
    from pinotwin.bench.table import document, markdown
    from pinotwin.report.blind import bench_page

    for name, value in {"seeds": seeds, "workers": workers, "cases": cases}.items():
        if value is not None and value < 1:
            raise InputError(f"--{name}: must be at least 1")
    if not 2.0 <= seconds <= 120.0:
        raise InputError(f"--seconds: {seconds:g}: expected 2 to 120")
    if limit_minutes is not None and limit_minutes <= 0.0:
        raise InputError("--limit-minutes: must be positive")
    if seed < 0:
        raise InputError("--seed: must not be negative")
    folder = Path(out)
    drawn = some(draw_cases(machines or MACHINES, seeds, situations=situations, seed=seed), cases)
    with progress() as report:
        answers = run_bench(drawn, Plan(folder, seconds, workers, limit_minutes, quick), report)
    content = document(answers, len(drawn))
    text = markdown(content)
    write_json(folder / "bench.json", content)
    write_text(folder / "bench.md", text)
    write_text(folder / "bench.html", bench_page(content).html())
    return Answer([text], content)
