r"""The limits of false alarms, derived from healthy machines of several kinds and written to the rules.

For a healthy question every such rule has a least value at which the question stays silent, the other rules
as they are. Of N questions the k-th largest of these values is exceeded by a further one with probability
k / (N + 1), whatever their distribution (tolerance limits; Wilks 1941, doi:10.1214/aoms/1177731788): that
is the limit, for the largest k with k / (N + 1) <= alpha, or the largest of all where N is too small. A little is
added, for the same question needs a little more or less with every version of what prepares its logs.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.questions.healthy import Asked, Question, asked
from benchmarks.questions.other_machines import Elsewhere
from pinotwin.bench.engine import engine
from pinotwin.diagnosis.conclusion.residuals import gap_table, noise_levels
from pinotwin.diagnosis.data.comparison import Comparison, compare
from pinotwin.diagnosis.grade import stays
from pinotwin.diagnosis.pipeline import tried
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.forward import Found, rank, refused
from pinotwin.diagnosis.search.pushes import pushes
from pinotwin.diagnosis.search.scan import Searcher
from pinotwin.diagnosis.search.shortlist import Shortlist
from pinotwin.errors import DataError
from pinotwin.system.threads import one_blas_thread
from pinotwin.system.writing import write_text

ALPHA = 0.02
"""Probability of a false alarm by each rule, of another healthy question."""
CHANGE = ("excess", "push", "open_change")
"""Rules derived from questions of change."""
STRUCTURE = ("size_structure",)
"""Rules derived from questions of structure. What a model leaves open is none: of virtual machines it is 3 % of an
axis' effort, of real ones ten times as much."""
MORE = 1.05
"""What is added: of 34 questions the most demanding moved by 1 % with rows left out at the ends of its log."""


@dataclass(frozen=True)
class Limit:
    """A derived rule.

    Attributes:
        rule: its name.
        value: the limit; what is in force where no question reaches the rule at all.
        largest: what the questions need, largest first, at most five.
        questions: how many there were.
    """

    rule: str
    value: float
    largest: tuple[float, ...]
    questions: int


def least(rule: str, silent: Callable[[Rules], bool], rules: Rules = RULES) -> float:
    """Return the least value of a rule at which a question is silent, to 1 %; 0 if it is so without the rule.

    Args:
        rule: whose value is sought; a larger one never makes a silent question loud.
        silent: whether the question is silent under some rules.
        rules: the others.
    """

    def at(value: float) -> bool:
        return silent(with_value(rules, rule, value))

    if at(0.0):
        return 0.0
    high = float(getattr(rules, rule))
    for _ in range(20):
        if at(high):
            break
        high *= 2.0
    else:
        return math.inf
    low = 0.0
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if at(middle) else (middle, high)
    return high


def with_value(rules: Rules, rule: str, value: float) -> Rules:
    """Return rules of which one has another value."""
    values: dict[str, Any] = {rule: value}
    return replace(rules, **values)


@one_blas_thread
def reached(given: Asked, rules: Rules = RULES) -> dict[str, float]:
    """Return, for every rule that a healthy question concerns, the least value that keeps it silent."""
    c = compare(given.subject, given.logs, given.validation)
    searcher = Searcher(c)
    nothing = Found((), None, (), searcher, searcher)
    name = "excess" if c.change else "size_structure"
    best = rank(searcher, Shortlist(tried(c), with_value(rules, name, 0.0)).of(searcher))
    loud = [r for r in best if not refused(r, searcher, with_value(rules, name, 0.0))]
    out = {name: least(name, lambda x: all(refused(r, searcher, x) for r in loud), rules)}
    if c.change:
        out["push"] = least("push", lambda x: not pushes(c, nothing, x), rules)
        out["open_change"] = _stays(c, nothing)
    return out


def _stays(c: Comparison, nothing: Found) -> float:
    """Return the most that stays of an axis' gap where nothing is named."""
    gaps, out = gap_table(c, {}, noise_levels(c)[0]), [0.0]
    for j in c.new.joints:
        g = gaps[c.machine.names[j]]["u"]
        out.append(stays(g.after, g.noise, g.misfit, c.new.size(j)))
    return max(out)


def derived(values: Sequence[Mapping[str, float]], alpha: float = ALPHA, rules: Rules = RULES) -> list[Limit]:
    """Return the limits that hold the false alarms, from what healthy questions need.

    Args:
        values: of every question, rule -> least value; see :func:`reached`.
        alpha: probability that a further question needs more.
        rules: in force: a rule that no question needs keeps its value.
    """
    out = []
    for rule in (*CHANGE, *STRUCTURE):
        each = sorted((v[rule] for v in values if rule in v), reverse=True)
        if not each:
            continue
        k = max(1, math.floor(alpha * (len(each) + 1)))
        limit = each[min(k, len(each)) - 1]
        value = _rounded_up(MORE * limit) if 0.0 < limit < math.inf else float(getattr(rules, rule))
        out.append(Limit(rule, value, tuple(each[:5]), len(each)))
    return out


def _rounded_up(value: float) -> float:
    """Return a value rounded up to two digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / step - 1e-9) * step:.3g}")


def measured(
    questions: Sequence[Question],
    work: Path,
    elsewhere: Elsewhere | None,
    workers: int,
    tell: Callable[[str], None],
) -> list[tuple[Question, dict[str, float]]]:
    """Return what every healthy question needs; one that cannot be asked is told and left out."""
    for machine in {q.machine for q in questions if q.kind == "real"}:
        assert elsewhere is not None
        elsewhere.real(machine)  # written once, before the processes read it
    out = []
    one = functools.partial(_one, work=work, elsewhere=elsewhere)
    with engine(workers) as each:
        for question, found in each(one, questions, None):
            if isinstance(found, BaseException):
                tell(f"{question}: {type(found).__name__}: {found}")
                continue
            tell(f"{question}: " + ", ".join(f"{k} {v:.3g}" for k, v in found.items()))
            out.append((question, found))
    return out


def _one(question: Question, work: Path, elsewhere: Elsewhere | None) -> dict[str, float]:
    return reached(asked(question, work, elsewhere))


def write_rules(file: Path, limits: Sequence[Limit], command: str, date: str) -> None:
    """Write derived values into the file of the rules: the fields, and the table of where they come from.

    Args:
        file: ``rules.py``.
        limits: derived.
        command: that derived them.
        date: when.

    Raises:
        DataError: the file does not hold such a rule.
    """
    text = file.read_text(encoding="utf-8")
    for limit in limits:
        text = _put(text, rf"(?m)^(    {limit.rule}: float = ).*$", repr(float(limit.value)), limit.rule)
    rows = (f'    "{x.rule}": ({float(x.value)!r}, {x.largest[0]:.3g}, {x.questions}),\n' for x in limits)
    text = _put(text, r"(?ms)^(DERIVED: [^\n]*= \{).*?(?=\}$)", "\n" + "".join(rows), "DERIVED")
    text = _put(text, r"(?m)^(COMMAND = ).*$", f'"{command}"', "COMMAND")
    text = _put(text, r"(?m)^(DATE = ).*$", f'"{date}"', "DATE")
    write_text(file, text)


def _put(text: str, pattern: str, value: str, name: str) -> str:
    out, count = re.subn(pattern, lambda m: m.group(1) + value, text)
    if count != 1:
        raise DataError(f"rules: {name!r} stands there {count} times, expected once")
    return out
