"""Tables with one value a row, and the name of what it is a value of beside it (OPC UA, MTConnect, InfluxDB).

Such loggers write a value when it changes: it is kept until its next row, and is missing before its first.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

import numpy as np
import pyarrow as pa

from pinotwin.logs.files.clocks import CARRIED, held
from pinotwin.logs.files.content import Content

_TITLES = {
    "names": "displayname browsename name tagname tag signalname signal variablename variable symbol channel field "
    "metric item itemname dataitem dataitemname dataitemid itemid nodeid node id key",
    "values": "value val wert numericvalue valuenumeric currentvalue",
    "status": "status statuscode quality",
    "units": "unit units einheit engineeringunits",
}
_NAMES, _VALUES, _STATUS, _UNITS = (words.split() for words in _TITLES.values())
_NODE = re.compile(r"(?:ns=\d+;)?[sigb]=|nsu=[^;]*;[sigb]=")
_WORDS = {"true": 1.0, "false": 0.0}


def value_column(names: Sequence[str], texts: Collection[str]) -> str | None:
    """Return the column of values of a table in long form, one of whose ``texts`` says what each is of; else None."""
    value = _titled(names, _VALUES)
    return value if any(_folded(name) in _NAMES for name in texts if name != value) else None


def spread(table: pa.Table, clock: str, content: Content) -> bool:
    """Move the channels of a table in long form into ``content``; False where it is none."""
    texts = [n for n, c in zip(table.column_names, table.columns, strict=True) if is_text(c.type)]
    value = value_column(table.column_names, texts)
    named = [name for name in texts if _folded(name) in _NAMES and name != value]
    if value is None:
        return False
    columns = {
        name: np.array(table.column(name).to_pylist(), dtype=object) for name in (*texts, clock, value)
    }
    named.sort(key=lambda name: (-len(set(columns[name])), _NAMES.index(_folded(name))))
    t = columns[clock].astype(float)
    rows = np.flatnonzero(np.isfinite(t))
    rows = rows[np.argsort(t[rows], kind="stable")]
    x = np.array([_number(cell) for cell in columns[value]])
    status, unit = _titled(texts, _STATUS), _titled(texts, _UNITS)
    if status:
        x[[str(cell).casefold().startswith("bad") for cell in columns[status]]] = np.nan
    keys = np.array([_NODE.sub("", str(name), count=1) for name in columns[named[0]]], dtype=object)
    for other in (name for name in texts if name not in (*named, value, status, unit)):
        joined = np.array([f"{a}.{b}" for a, b in zip(columns[other], keys, strict=True)], dtype=object)
        if len(set(zip(t, joined, strict=True))) > len(set(zip(t, keys, strict=True))):
            keys = joined  # one name of two devices
    stamps, carried = np.unique(t[rows]), []
    content.add(clock, stamps)
    for name in dict.fromkeys(keys[rows]):
        own = rows[keys[rows] == name]
        if not np.isfinite(x[own]).any():
            content.left_out.append(name)
            continue
        content.add(name, held(t[own], x[own], stamps))
        if unit and columns[unit][own[0]]:
            content.units[name] = columns[unit][own[0]]
        if len(np.unique(t[own])) < len(stamps):
            carried.append(f"{name} ({len(own)} of {len(stamps)} rows)")
    content.place = "row {}".format
    content.notes.append(f"one value a row: spread by {named[0]} into a channel a name")
    if carried:
        content.notes.append(f"{CARRIED}: {', '.join(carried)}")
    return True


def is_text(kind: pa.DataType) -> bool:
    """Whether a column holds words."""
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind)


def _titled(names: Sequence[str], titles: Sequence[str]) -> str | None:
    found = [name for name in names if _folded(name) in titles]
    return min(found, key=lambda name: titles.index(_folded(name)), default=None)


def _folded(name: str) -> str:
    return re.sub(r"[\W_]+", "", name).casefold()


def _number(cell: object) -> float:
    text = str(cell).strip().casefold()
    try:
        return _WORDS[text] if text in _WORDS else float(text.replace(",", "."))
    except ValueError:
        return float("nan")
