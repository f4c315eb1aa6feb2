"""``pinotwin diagnose twin today.csv today2.csv --validate other.csv --out found``: a log against its model."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.cli.arguments import Answer, Folder, Repeated, Several, Share
from pinotwin.cli.each import Asked, Fill, each_answered
from pinotwin.cli.inputs import check_there, read_logs, resampled
from pinotwin.cli.output import columns
from pinotwin.cli.progress import Report, progress, silent
from pinotwin.errors import InputError
from pinotwin.system.stamps import stamp

if TYPE_CHECKING:
    from pinotwin.diagnosis import Diagnosis
    from pinotwin.machine import Machine
    from pinotwin.twin import Twin


def run(
    subject: str,
    logs: Several,
    *,
    validate: Repeated = (),
    resample: float | None = None,
    quick: bool = False,
    fail_on_gap: bool = False,
    seed: int = 0,
    each: bool = False,
    workers: int | None = None,
    meshes: str | None = None,
    effects: Repeated = (),
    false_alarm: Share = 0.02,
    worth: Share = 0.01,
    out: Folder,
) -> Answer:
    """Diagnose, save, and say what was found, the verdict first.

    Args:
        subject (TWIN|MACHINE): folder of a twin, or a machine folder, machine.yaml, .urdf, bundled name
        logs (LOG): servo log(s); those with the same command are repeats: they measure the noise
        validate (LOG): log of the same state as LOG, not used to fit; the reduction is stated on it (without one:
            cross-validated on LOG)
        quick: screen only: fewer draws, one effect
        fail_on_gap: exit 1 unless the verdict is none
        each: diagnose every log by itself (a folder stands for the logs in it): a folder each below --out, a page and
            a table of all (each.html, each.csv, each.json); run again, it goes on with what is missing or has
            changed. Exit code 2 if a log could not be diagnosed (a line of the table; the others are done all the
            same), else 1 with --fail-on-gap and any verdict but none, else 0
        workers (N): processes of --each (default: one for each processor)
        false_alarm (P): share of healthy logs that may be called changed, of logs with commands or a twin of three logs
        worth (P): smallest cause worth a word, over the effort of its axis
        out (PATH): folder for diagnosis.json and its files
    """
    options = {"quick": quick, "seed": seed, "false_alarm": false_alarm, "worth": worth}
    asked = Asked(subject, tuple(validate), resample, meshes, options, tuple(effects))
    if each:
        # what concerns all logs is refused here, in one line, and not in every line of the table
        _loaded(asked)
        read_logs(validate)
        return each_answered(logs, asked, diagnose_one, Path(out), workers=workers, fail_on_gap=fail_on_gap)
    if workers is not None:
        raise InputError("--workers: is for many logs; add --each, which diagnoses every log by itself")
    check_there(*logs, *validate)
    with progress() as report:
        found = _diagnosed(logs, asked, report)
        from pinotwin.report.saved import save_diagnosis

        said = save_diagnosis(found, Path(out), meshes)
    last = f"diagnosis written to {out}; open {Path(out) / 'report.html'}"
    code = 1 if fail_on_gap and found.verdict != "none" else 0
    return Answer([*summary(found), *said, last], found.to_dict(), code)


def diagnose_one(log: str, asked: Asked) -> tuple[dict[str, Any], Fill]:
    """Diagnose one log: the content of diagnosis.json, and what fills a folder with the result."""
    from pinotwin.effects.known import given_files
    from pinotwin.report.saved import write_diagnosis

    with given_files(asked.effects):  # a worker is another process
        found = _diagnosed([log], asked, silent)
    return found.to_dict(), lambda folder: write_diagnosis(found, folder, asked.meshes)


def _diagnosed(names: Sequence[str], asked: Asked, report: Report) -> Diagnosis:
    """Return the diagnosis, with its date and the time that it took."""
    subject = _loaded(asked)
    from pinotwin.diagnosis import diagnose

    began, unseen = time.monotonic(), read_logs(asked.validate) or None
    found = diagnose(subject, read_logs(names), validate=unseen, report=report, **asked.options)
    return replace(found, provenance={**found.provenance, **stamp(began)})


def _loaded(asked: Asked) -> Machine | Twin:
    """Return the twin in a folder that holds one, else the machine, on the clock that was asked for."""
    from pinotwin.twin.twin import as_subject

    return resampled(as_subject(asked.subject), asked.resample)


def summary(found: Diagnosis) -> list[str]:
    """Return the few lines that a user wants to see, the verdict first."""
    from pinotwin.report.diagnosis_verdict import headline, states

    lines = [f"{found.machine}: {found.verdict.replace('_', ' ')}", *headline(found)]
    lines += ["axes: " + ", ".join(word for word, _ in states(found))] if found.gap else []
    if found.quick:
        lines.append("quick: candidates screened, not verified")
    lines += ["", *gap_lines(found), "", *cause_lines(found), *where_lines(found)]
    lines += [f"warning: {text}" for text in found.warnings]
    if found.noise == "assumed":
        lines.append("noise: assumed (no command was recorded twice)")
    return lines + [f"next: {text}" for text in next_lines(found)]


def gap_lines(found: Diagnosis) -> list[str]:
    """Return the table of the residuals, each with its unit and its grade."""
    from pinotwin.diagnosis.grade import printed
    from pinotwin.report.diagnosis_verdict import rotary_axes
    from pinotwin.report.display import scale_of

    rotary = rotary_axes(found)
    rows = []
    for axis, row in found.gap.items():
        for signal, g in row.items():
            scale = scale_of(signal, rotary.get(axis, False), g.rms)
            known = (g.rms, g.after, g.level or float("nan"), g.noise or float("nan"))
            sizes = [scale.text(x) if x == x else "-" for x in known]
            rows.append([f"{axis}.{signal}", *sizes, printed(found.grade(axis, signal))])
    return columns(("RMS", "residual", "with causes", "expected", "noise", "grade"), rows, left=(0, 5))


def cause_lines(found: Diagnosis, likely: float = 0.05) -> list[str]:
    """Return every cause, named or possible, with its size, its confidence and what else it could be, if likely."""
    from pinotwin.diagnosis.conclusion.sizes import interval_text, size_text, times_text, told
    from pinotwin.diagnosis.phrases import on_axis, rivals

    lines = []
    for e in (*found.effects, *found.possible):
        spans = [(s, f"90 %: {interval_text(s)}", times_text(s)) for s in told(e.size)[:3]]
        sizes = [f"{size_text(s)} ({', '.join(filter(None, about))})" for s, *about in spans]
        word = "possible" if e in found.possible else "effect"
        lines.append(f"{word}: {on_axis(e.effect, e.axis)}, confidence {e.confidence:.0%}")
        lines += [f"        {text}" for text in sizes]
        others = ", ".join(x for x, (p, _) in rivals(e, found.effects).items() if p >= likely)
        if others:
            lines.append(f"        also possible: {others}")
    return lines


def where_lines(found: Diagnosis) -> list[str]:
    """Return where in motion and time the residual lies."""
    from pinotwin.diagnosis.conclusion.where import telling
    from pinotwin.diagnosis.phrases import region_words

    return [
        f"where: {r.share:.0%} of the residual variance of {r.axis}.{r.signal} lies {region_words(r)} "
        f"({max(r.time_share, 0.01):.0%} of the {'band' if r.kind == 'frequency' else 'time'})"
        for r in telling(found.where, [str(e.axis) for e in found.effects])[:3]
    ]


def next_lines(found: Diagnosis) -> list[str]:
    """Return what a person can do next, at the machine first."""
    from pinotwin.diagnosis.phrases import on_axis, remedy

    lines = [f"{on_axis(e.effect, e.axis)}: {remedy(e.effect)}" for e in found.effects if remedy(e.effect)]
    files = f"record the motion of {', '.join(found.commands)} (in the folder)" if found.commands else ""
    return [*lines, *found.advice, *([files] if files else [])]
