"""Several clocks in one file: channels of equal clocks are joined, the others put on the one with most channels.

What was sampled about as often is interpolated onto it, and said to be; what was sampled less often is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pinotwin.arrays import Floats
from pinotwin.errors import LogError
from pinotwin.logs.files.content import Content
from pinotwin.logs.files.messages import Table, seconds_since

Arrays = Mapping[str, NDArray[np.generic]]
CARRIED = "written on change, carried forward to the next"


@dataclass
class Group:
    """Channels that share a clock."""

    clock: str  # name of the clock, for messages
    t: Floats  # its time stamps, shape (n,), NaN where the clock has ended
    channels: dict[str, NDArray[np.generic]] = field(default_factory=dict)  # name -> values, (n,)

    def whole(self, source: str) -> Group:
        """Return the group without the rows behind the clock's end."""
        rows = np.flatnonzero(np.isfinite(self.t))
        if not len(rows):
            raise LogError(f"{source}: the clock {self.clock!r} holds no number; export it again")
        keep = slice(0, rows[-1] + 1)
        return Group(self.clock, self.t[keep], {k: x[keep] for k, x in self.channels.items()})

    @property
    def step(self) -> float:
        """Usual distance of two stamps, in the clock's unit."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf


def on_one_clock(
    groups: list[Group], source: str, slower: float = 1.5
) -> tuple[Floats, dict[str, Floats], list[str]]:
    """Return the main clock, the channels of all clocks not ``slower`` on it, and what was done, in a sentence each."""
    joined: list[Group] = []
    for group in (g.whole(source) for g in groups if g.channels):
        same = next((g for g in joined if np.array_equal(g.t, group.t, equal_nan=True)), None)
        if same is None:
            joined.append(Group(group.clock, group.t, dict(group.channels)))
        else:
            same.channels.update(group.channels)
    if not joined:
        raise LogError(f"{source}: holds clocks but no channels; export the signals too")
    main = max(joined, key=lambda g: (len(g.channels), len(g.t)))
    notes = []
    if len(joined) == 1 and len(groups) > 1:
        notes.append(f"{len(groups)} equal clocks were joined into t")
    channels: dict[str, Floats] = {k: np.asarray(x, dtype=float) for k, x in main.channels.items()}
    for group in (g for g in joined if g is not main):
        names = ", ".join(list(group.channels)[:8])
        if group.step <= slower * main.step:
            notes.append(f"interpolated onto the clock of the others (own step {group.step:.4g}): {names}")
            channels |= {k: _onto(main.t, group.t, np.asarray(x, float)) for k, x in group.channels.items()}
        else:
            notes.append(
                f"left out, sampled every {group.step:.4g} where the others are every {main.step:.4g}: "
                f"{names}; record them at one rate"
            )
    return main.t, channels, notes


def _onto(t: Floats, own: Floats, x: Floats) -> Floats:
    known = np.isfinite(own) & np.isfinite(x)
    if known.sum() < 2:
        return np.full(len(t), np.nan)
    order = np.argsort(own[known], kind="stable")
    return np.asarray(np.interp(t, own[known][order], x[known][order], left=np.nan, right=np.nan))


def take_messages(
    content: Content, topic: str, prefix: str, table: Table, source: str, clock: str = ""
) -> None:
    """Add the numbers of one topic's messages under a prefix; those that have a time go on one clock ``t``.

    Where no channel is called so, that is the stamps, if every message has one: of the ``clock``, which is said.
    """
    arrays: Arrays = table.arrays()
    if "t" not in arrays and len(table.stamps) == table.rows:
        arrays = {**arrays, "t": seconds_since(table.stamps[0], table.stamps)}
        content.units[f"{prefix}t"] = "s"
        content.notes += [f"{prefix}t: {clock}, in seconds since the first message"] if clock else []
    channels = {name: x for name, x in arrays.items() if name != "t"}
    if "t" in arrays and channels:
        groups, notes = streams(topic, np.asarray(arrays["t"], dtype=float), channels)
        t, joined, said = on_one_clock(groups, source)
        arrays = {"t": t, **joined}
        content.notes += [*notes, *said]
    for name, x in arrays.items():
        content.add(prefix + name, x)


def streams(name: str, t: Floats, arrays: Arrays) -> tuple[list[Group], list[str]]:
    """Return the groups of messages at ``t`` [s] of one topic, NaN for what one does not hold, and what was done."""
    kept = fresh(t, arrays)
    notes = [f"{len(t) - len(kept)} repeated messages were dropped"] if len(kept) < len(t) else []
    rows = {name: t[kept], **{key: x[kept] for key, x in arrays.items()}}
    apart = separated(name, rows, *known_rows(name, rows))
    return apart or [Group(name, t[kept], {key: rows[key] for key in arrays})], notes


def fresh(t: Floats, arrays: Arrays) -> NDArray[np.intp]:
    """Return the messages that repeat no earlier one, stamp and numbers; arguments as of :func:`streams`."""
    if len(np.unique(t)) == len(t):  # the usual case needs no table of all numbers
        return np.arange(len(t))
    table = np.column_stack([np.asarray(x, dtype=float) for x in (t, *arrays.values())])
    _, first = np.unique(table.view(f"V{table.itemsize * table.shape[1]}"), return_index=True)
    return np.sort(first)


def known_rows(clock: str, arrays: Arrays) -> tuple[Floats, dict[str, NDArray[np.bool_]]]:
    """Return the stamps, shape (n,), and for every channel that holds something the rows where it does."""
    t = np.asarray(arrays[clock], dtype=float)
    alike = {n: np.asarray(x, dtype=float) for n, x in arrays.items() if n != clock and x.shape == t.shape}
    known = {name: np.isfinite(x) for name, x in alike.items()}
    return t, {name: here for name, here in known.items() if here.any()}


def separated(clock: str, arrays: Arrays, t: Floats, known: Mapping[str, NDArray[np.bool_]]) -> list[Group]:
    """Return the groups of a table of several clocks in one column, of channels known in the same rows; or none."""
    rows: dict[bytes, list[str]] = {}
    for name, here in known.items():
        rows.setdefault(np.packbits(here).tobytes(), []).append(name)
    if len(rows) < 2:
        return []
    main = known[max(rows.values(), key=lambda names: len(names) * known[names[0]].sum())[0]]
    out = [Group(clock, t[main])]
    for names in rows.values():
        here = known[names[0]]
        if 2 * (here & main).sum() < here.sum():
            out.append(Group(f"{clock} of {names[0]}", t[here], {name: arrays[name][here] for name in names}))
        else:
            out[0].channels.update({name: arrays[name][main] for name in names})
    return out if len(out) > 1 else []


def written_on_change(arrays: Arrays, known: Mapping[str, NDArray[np.bool_]]) -> bool:
    """Whether cells are empty because nothing changed: no channel repeats a value, rows differ in what they hold."""
    table = np.array(list(known.values()))
    if not len(table) or 2 * table.all(axis=0).sum() >= table.shape[1] or not table.any(axis=0).all():
        return False
    values = (np.asarray(arrays[name], dtype=float)[here] for name, here in known.items())
    if any(bool((np.diff(x) == 0.0).any()) for x in values):
        return False
    together = (table @ table.T.astype(float)) / np.maximum(table.sum(axis=1), 1)[:, None]
    return bool(((together > 0.0) & (together < 1.0) & (together.T < 1.0)).any())


def held(own: Floats, x: Floats, t: Floats) -> Floats:
    """Return values at the stamps ``t``: the last that was written until then, missing before the first."""
    place = np.searchsorted(own, t, side="right") - 1
    return np.asarray(np.where(place >= 0, x[place], np.nan))
