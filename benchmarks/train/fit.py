"""Train the decision on evidence rows, whole machines left out.

A line of a file of rows is a question: machine, case, kind, open, noise, rows (each with ``right``), and the rows
beside the best right cause (``second``). Printed is what is said on machines that the weights have not seen.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.decision import FEATURES, GROUP_NAMES, Case, Decision, channel, known
from pinotwin.diagnosis.days.judge import Named, decided, family
from pinotwin.diagnosis.days.row import Row
from pinotwin.diagnosis.settings import SETTINGS

RATES = (0.02, 0.05, 0.10)
RIDGE, OUTSIDE, FORMED, FEW = 15.0, 0.3, 0.1, 3.0
"""Ridge of the weights; what a question counts whose cause was taken away, or whose effort was put in by a formula; and
the score [nats] below which saying nothing is right as well."""


class Asked:
    """A question as the logit reads it: its case, and which of its alternatives are right."""

    def __init__(
        self,
        line: Mapping[str, Any],
        rows: Sequence[Mapping[str, Any]],
        *,
        first: bool,
        outside: bool = False,
    ):
        self.line = line
        every = [(_row(x), bool(x["right"])) for x in rows if np.isfinite([x["score"], x["z"]]).all()]
        good = [r for r, right in every if right]
        if outside:
            every = [
                (r, False) for r, _ in every if r.group == "describe" or not any(_kin(r, g) for g in good)
            ]
        opened = line["open"] if first else line["second"][0]["open"]
        touched = () if first else line["second"][0]["touched"]
        self.case = Case.of([r for r, _ in every], opened, line["noise"], touched)
        right = {id(r) for r, yes in every if yes}
        self.right = [k + 2 for k, r in enumerate(self.case.causes) if id(r) in right]
        best = max((self.case.causes[k - 2].score for k in self.right), default=-99.0)
        self.right = [
            k for k in self.right if self.case.causes[k - 2].score > max(0.5 * best, self._least(k))
        ]
        if healthy(line) and first:
            self.right = [0]
        elif outside or (not self.right and first and line["kind"] == "command_jitter"):
            self.right = [1]
        elif not self.right:
            self.right = [0, 1] if first else [0]
        elif best < FEW:
            self.right = [*self.right, 0, 1]

    def _least(self, k: int) -> float:
        """Return nine tenths of the best right score of one kind of change on its axis [nats]."""
        one = self.case.causes[k - 2]
        kin = [x for i in self.right if _kin(x := self.case.causes[i - 2], one)]
        return 0.9 * max(x.score for x in kin)


def healthy(line: Mapping[str, Any]) -> bool:
    """Whether nothing has changed in a question."""
    return str(line["kind"]).startswith(("none", "healthy"))


def _row(x: Mapping[str, Any]) -> Row:
    known = {f.name for f in fields(Row)}
    return Row(**{k: v for k, v in x.items() if k in known})


def _kin(a: Row, b: Row) -> bool:
    near = ({"friction", "onset", "cross"}, {"time", "place"}, {"offset", "scale"})
    alike = a.group == b.group or any({a.group, b.group} <= x for x in near)
    return (a.axis == b.axis and alike) or a.group == b.group == "body"


def asked(lines: Sequence[Mapping[str, Any]]) -> tuple[list[Asked], list[float]]:
    """Return the questions of some lines with their weights: first and second round, and causes taken away."""
    out, weights = [], []
    for line in lines:
        counts = FORMED if line["kind"].startswith("formed") else 1.0
        out.append(Asked(line, line["rows"], first=True))
        weights.append(counts)
        for second in line["second"]:
            out.append(Asked(line, second["rows"], first=False))
            weights.append(0.5 * counts)
        best = max((x["score"] for x in line["rows"] if x["right"]), default=0.0)
        if best > 12.0 and not line["kind"].startswith("spoil_") and "+" not in line["kind"]:
            out.append(Asked(line, line["rows"], first=True, outside=True))
            weights.append(OUTSIDE * counts)
    return out, weights


def null_scores(lines: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return group or channel -> score that 95 % of healthy questions stay below [nats]."""
    best: dict[str, list[float]] = {}
    cases = [Asked(x, x["rows"], first=True).case for x in lines if healthy(x)]
    for case in cases:
        top: dict[str, float] = {}
        for r in (*case.causes, *case.described):
            top[channel(r)] = max(top.get(channel(r), 0.0), r.score)
        for key, x in top.items():
            best.setdefault(key, []).append(x)
    return {k: float(np.quantile([*x, *[0.0] * (len(cases) - len(x))], 0.95)) for k, x in best.items()}


def fitted(questions: Sequence[Asked], weights: Sequence[float], null: Mapping[str, float]) -> Decision:
    """Return the conditional logit; weights with a known sign are held to it, a ridge draws the rest to none."""
    each = [q.case.features(null) for q in questions]
    X, n = np.concatenate(each), np.array([len(x) for x in each])
    start, seg = np.r_[0, np.cumsum(n)[:-1]], np.repeat(np.arange(len(n)), n)
    right = np.zeros(len(X))
    for a, q in zip(start, questions, strict=True):
        right[a + np.array(q.right)] = 1.0
    f, g = len(FEATURES), len(GROUP_NAMES)
    cause = X[:, f : f + g].any(axis=1)
    mean, scale = np.zeros(X.shape[1]), np.ones(X.shape[1])
    mean[:f], scale[:f] = X[cause][:, :f].mean(axis=0), X[cause][:, :f].std(axis=0) + 1e-6
    Z, w = (X - mean * cause[:, None]) / scale, np.asarray(weights)
    free = np.r_[np.ones(f), np.full(g, 0.3), 0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0]

    def loss(t: Floats) -> tuple[float, Floats]:
        v = Z @ t
        e = np.exp(v - np.maximum.reduceat(v, start)[seg])
        P = e / np.add.reduceat(e, start)[seg]
        held = np.maximum(np.add.reduceat(P * right, start), 1e-12)
        d = (P - P * right / held[seg]) * w[seg]
        return float(-w @ np.log(held) + RIDGE * (free * t) @ t / 2.0), Z.T @ d + RIDGE * free * t

    signs = [(0.0, None) if s > 0 else (None, 0.0) if s < 0 else (None, None) for s in FEATURES.values()]
    open_bounds = [
        (None, None),
        (None, 0.0),
        (None, None),
        (0.0, None),
        (0.0, None),
        (0.0, None),
        (None, None),
        (None, None),
    ]
    bounds = [*signs, *[(None, None)] * g, *open_bounds]
    t = minimize(
        loss, np.zeros(X.shape[1]), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 500}
    ).x
    return Decision(mean, scale, t, dict(null), {}, {})


def trained_on(lines: Sequence[Mapping[str, Any]]) -> Decision:
    """Return the decision of some lines, without its limits."""
    return fitted(*asked(lines), null_scores(lines))


def limits(lines: Sequence[Mapping[str, Any]], folds: int = 4) -> dict[str, dict[float, float]]:
    """Return days -> rate -> P(nothing) that so many healthy questions of machines left out stay below (Vovk 2005)."""
    machines, seen = sorted({x["machine"] for x in lines}), dict[str, list[float]]()
    for k in range(min(folds, len(machines))):
        out = set(machines[k::folds])
        d = trained_on([x for x in lines if x["machine"] not in out])
        for x in lines:
            if x["machine"] in out and healthy(x):
                P = d.probabilities(Asked(x, x["rows"], first=True).case)
                seen.setdefault(known(x["days"]), []).append(float(P[0]))
    return {k: {a: sorted(x)[max(int(a * (len(x) + 1)), 1) - 1] for a in RATES} for k, x in seen.items()}


def left_out(lines: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return what is said of every question by weights that have not seen its machine."""
    out = []
    for machine in sorted({x["machine"] for x in lines}):
        rest = [x for x in lines if x["machine"] != machine]
        d, at = trained_on(rest), limits(rest)
        for line in (x for x in lines if x["machine"] == machine):
            out.append(_said(d, at[known(line["days"])], line))
    return out


def answered(d: Decision, q: Asked) -> tuple[float, Named | None, bool]:
    """Return P(nothing) [1], the likeliest cause as a diagnosis has it, and whether that is right."""
    P, one = decided(q.case, d)
    return float(P[0]), one, one is not None and q.case.causes.index(one.row) + 2 in q.right


def sure(one: Named | None) -> bool:
    """Whether a diagnosis names a cause; otherwise something unknown has changed."""
    return one is not None and one.probability >= SETTINGS.likely


def _said(d: Decision, at: Mapping[float, float], line: Mapping[str, Any]) -> dict[str, Any]:
    q = Asked(line, line["rows"], first=True)
    nothing, one, fits = answered(d, q)
    row, extra = None if one is None else one.row, None
    for second in line["second"] if row is not None else ():
        if second["beside"][1] == row.axis and family(second["beside"][0]) == family(row.name):
            none, other, well = answered(d, Asked(line, second["rows"], first=False))
            if other is not None and sure(other) and not well:
                extra = (none, other.row.name, other.row.axis)
    return {
        "line": line,
        "nothing": nothing,
        "limits": at,
        "name": "unknown" if row is None else row.name,
        "axis": "" if row is None else row.axis,
        "probability": 0.0 if one is None else one.probability,
        "fits": fits,
        "named": sure(one),
        "right": fits if sure(one) else 1 in q.right,
        "extra": extra,
    }


def outside(lines: Sequence[Mapping[str, Any]]) -> None:
    """Print what is said where the right cause and its kin are taken away, by weights that never saw that kind."""
    count = {"nothing": 0, "unknown": 0, "another": 0}
    for kind in sorted({x["kind"] for x in lines}):
        every = [
            x
            for x in lines
            if x["kind"] == kind and not kind.startswith(("spoil_", "none")) and "+" not in kind
        ]
        every = [x for x in every if max((r["score"] for r in x["rows"] if r["right"]), default=0.0) > 12.0]
        if not every:
            continue
        rest = [x for x in lines if x["kind"] != kind]
        d, at = trained_on(rest), limits(rest)
        for line in every:
            nothing, one, _ = answered(d, Asked(line, line["rows"], first=True, outside=True))
            silent = nothing >= at[known(line["days"])][RATES[0]]
            count["nothing" if silent else "another" if sure(one) else "unknown"] += 1
    print("cause taken away:", count)


def table(said: Sequence[Mapping[str, Any]]) -> None:
    """Print what is said, kind by kind, and at every false-alarm rate."""
    rate = RATES[0]
    speaks = [x["nothing"] < x["limits"][rate] for x in said]
    kinds = sorted({x["line"]["kind"] for x in said}, key=lambda k: (k.startswith("spoil"), k))
    for kind in kinds:
        rows = [(x, s) for x, s in zip(said, speaks, strict=True) if x["line"]["kind"] == kind]
        good = sum(s and x["right"] for x, s in rows)
        extra = sum(bool(s and x["extra"] and x["extra"][0] < x["limits"][rate]) for x, s in rows)
        print(
            f"{kind:24} asked {len(rows):3}  spoken {sum(s for _, s in rows):3}  right {good:3}  extra {extra:3}"
        )
    for rate in RATES:
        speaks = [x["nothing"] < x["limits"][rate] for x in said]
        well = [s for x, s in zip(said, speaks, strict=True) if healthy(x["line"])]
        ill = [s and x["right"] for x, s in zip(said, speaks, strict=True) if not healthy(x["line"])]
        told = [x for x, s in zip(said, speaks, strict=True) if s and x["name"] != "unknown"]
        p, ok = np.array([x["probability"] for x in told]), np.array([x["fits"] for x in told])
        false = sum(x["named"] and not x["right"] for x in told)
        print(
            f"false alarm {rate:.2f}: healthy spoken of {sum(well)}/{len(well)}; right {sum(ill)}/{len(ill)}; "
            f"named {sum(x['named'] for x in told)}, wrong {false}; of these and the possible ones "
            f"ECE {calibration(p, ok):.3f}, AUC {discrimination(p, ok):.3f}"
        )


def calibration(p: Floats, right: Floats, bins: int = 8) -> float:
    """Return the expected calibration error of probabilities."""
    edges = np.quantile(p, np.linspace(0.0, 1.0, bins + 1))
    at = np.clip(np.searchsorted(edges, p, "right") - 1, 0, bins - 1)
    return float(
        sum(abs(p[at == b].mean() - right[at == b].mean()) * np.mean(at == b) for b in set(at.tolist()))
    )


def discrimination(p: Floats, right: Floats) -> float:
    """Return the chance that a right name is surer than a wrong one."""
    a, b = p[right], p[~right]
    return float(np.mean((a[:, None] > b) + 0.5 * (a[:, None] == b))) if len(a) and len(b) else float("nan")


def bars(d: Decision, lines: Sequence[Mapping[str, Any]], limit: float) -> dict[str, float]:
    """Return group -> score [nats] from which P(nothing) of nine changed machines of ten is below a limit.

    The logit of P(nothing) is fitted by a line in arcsinh of the score, where it is not sure yet.
    """
    seen: dict[str, list[tuple[float, float]]] = {}
    for line in lines:
        if healthy(line) or "+" in line["kind"]:
            continue
        q = Asked(line, line["rows"], first=True)
        good = [q.case.causes[k - 2] for k in q.right if k > 1]
        nothing = float(d.probabilities(q.case)[0])
        if good and 0.02 < nothing < 0.98:
            best = max(good, key=lambda r: r.score)
            seen.setdefault(best.group, []).append((best.score, nothing))
    out = {}
    for group, points in seen.items():
        score, p = np.array(points).T
        if len(points) >= 4:
            x, y = np.arcsinh(score / 5.0), np.log(p / (1.0 - p))
            slope, at = np.polyfit(x, y, 1)
            least = np.log(limit / (1.0 - limit)) - 1.28 * np.std(
                y - slope * x - at
            )  # nine of ten lie beyond it
            if slope < 0.0:
                out[group] = float(5.0 * np.sinh((least - at) / slope))
    return out


def written(lines: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write the weights of all lines."""
    d = trained_on(lines)
    at = limits(lines)
    data = {
        "mean": d.mean.tolist(),
        "scale": d.scale.tolist(),
        "weights": d.weights.tolist(),
        "null": dict(d.null),
        "limits": {k: {str(a): x for a, x in row.items()} for k, row in at.items()},
        "bars": {k: bars(d, [x for x in lines if known(x["days"]) == k], at[k][RATES[0]]) for k in at},
        "machines": sorted({x["machine"] for x in lines}),
        "questions": len(lines),
    }
    path.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


def wrong(said: Sequence[Mapping[str, Any]]) -> None:
    """Print what goes wrong."""
    for x in said:
        line, limit = x["line"], x["limits"][RATES[0]]
        extra = x["extra"] if x["extra"] and x["extra"][0] < limit else None
        if (x["nothing"] < limit) == healthy(line) or not (x["right"] or healthy(line)) or extra:
            best = [(r["name"], r["axis"], round(r["score"]), r["right"]) for r in line["rows"][:5]]
            print(
                line["machine"],
                line["case"],
                f"{x['nothing']:.3f} < {limit:.3f}",
                x["name"],
                x["axis"],
                extra,
                best,
            )


def main(words: Sequence[str]) -> None:
    """Train, print the table, write the weights."""
    parser = argparse.ArgumentParser(prog="benchmarks train fit", description="train the decision")
    parser.add_argument("rows", nargs="+", type=Path, help="files of rows, or folders of them")
    parser.add_argument("--out", type=Path, help="where the weights go")
    parser.add_argument("--wrong", action="store_true", help="print what goes wrong")
    options = parser.parse_args(words)
    files = [f for p in options.rows for f in (sorted(p.glob("*.jsonl")) if p.is_dir() else [p])]
    lines = [json.loads(x) for f in files for x in f.read_text(encoding="utf-8").splitlines()]
    said = left_out(lines)
    table(said)
    outside(lines)
    if options.wrong:
        wrong(said)
    if options.out:
        written(lines, options.out)
