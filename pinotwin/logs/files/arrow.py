"""Columns of an Arrow table as arrays, shared by the text and the Parquet reader.

Joint states have the names of the joints in cells beside their numbers:

    rostopic echo -p           field.name0, field.name1 ..., field.position0, field.velocity0, field.effort0 ...
    ros2 topic echo --csv      no header: stamp, frame, names, positions, velocities, efforts, one after the other

Tables with one value a row, and the name of what it is a value of beside it (OPC UA, MTConnect, InfluxDB), are of
loggers that write a value when it changes: it is kept until its next row, and is missing before its first.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pinotwin.arrays import Floats
from pinotwin.log import JOINT_SIGNALS
from pinotwin.logs.files.cells import is_clock
from pinotwin.logs.files.clocks import CARRIED, held, known_rows, on_one_clock, separated, written_on_change
from pinotwin.logs.files.content import Content, distinct, repeated


def take(table: pa.Table, content: Content, source: str, blank_is_missing: bool = False) -> None:
    """Move the columns of a table, but text, into ``content``, on one clock unless ``blank_is_missing``."""
    names = distinct(table.column_names)
    content.stated.update(repeated(names, table.column_names))
    table = table.rename_columns(names)
    clock = next((name for name in names if is_clock(name) or content.units.get(name) == "s"), None)
    if clock is not None and _is_number(table.column(clock).type) and spread(table, clock, content):
        return
    texts: dict[str, str] = {}
    for name, column in zip(names, table.columns, strict=True):
        kind = column.type
        if pa.types.is_timestamp(kind) or pa.types.is_date(kind) or pa.types.is_duration(kind):
            content.add(name, column.to_numpy())
        elif pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind):
            _take_list(name, column, content)
        elif pa.types.is_null(kind):
            content.notes.append(f"{name}: all {len(column)} values are missing; left out")
        elif _is_number(kind):
            content.add(name, _floats(column))
        else:
            content.left_out.append(name)
            values = pc.unique(pc.drop_null(column)).to_pylist() if is_text(kind) else []
            texts.update({name: values[0]} if len(values) == 1 else {})
    _name_joints(names, texts, clock is None, content)
    if clock in content.arrays and not blank_is_missing:
        _onto_one_clock(clock, content, source)


def _name_joints(names: list[str], texts: dict[str, str], timeless: bool, content: Content) -> None:
    """Name the columns of joint states by ``texts``, what columns of one text hold; a clock is made of stamps."""
    joints = _by_header(texts, content.arrays) or _by_order(names, texts, content.arrays)
    if not joints:
        return
    t = _stamps(names, content.arrays) if timeless else None
    content.arrays = {joints.get(name, name): x for name, x in content.arrays.items()}
    found = dict.fromkeys(joint.rpartition(".")[0] for joint in joints.values())
    content.notes.append(f"joints by their names in the file: {', '.join(found)}")
    if t is not None:
        content.arrays = {"t": t, **{k: x for k, x in content.arrays.items() if k not in names[:2]}}
        content.units["t"] = "s"
        content.notes.append("t: seconds and nanoseconds of the stamps, from the first on")


def _onto_one_clock(clock: str, content: Content, source: str) -> None:
    """Put channels that stand in rows of their own (PlotJuggler) onto the clock of most; carry changes forward."""
    t, known = known_rows(clock, content.arrays)
    if written_on_change(content.arrays, known):
        for name, here in known.items():
            content.arrays[name] = held(t[here], content.arrays[name][here].astype(float), t)
        content.notes.append(f"{CARRIED}: {', '.join(known)}")
        return
    groups = separated(clock, content.arrays, t, known)
    if groups:
        t, channels, notes = on_one_clock(groups, source)
        content.arrays = {clock: t, **channels}
        content.notes += notes


def _is_number(kind: pa.DataType) -> bool:
    of = pa.types
    return of.is_integer(kind) or of.is_floating(kind) or of.is_boolean(kind) or of.is_decimal(kind)


def _floats(column: pa.ChunkedArray) -> np.ndarray:
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    wide = column if pa.types.is_float64(column.type) else column.cast(pa.float64(), safe=False)
    full = pc.fill_null(wide, float("nan")) if wide.null_count else wide
    # to_numpy would import pandas, which takes longer than reading most logs
    return np.concatenate([np.zeros(0), *(np.from_dlpack(chunk) for chunk in full.chunks if len(chunk))])


def _take_list(name: str, column: pa.ChunkedArray, content: Content) -> None:
    """A vector in every row becomes a matrix, if all rows hold as many numbers, and no more than there are rows."""
    lengths = pc.unique(pc.list_value_length(column)).to_pylist()
    flat = pc.list_flatten(column)
    if len(lengths) != 1 or not 0 < (lengths[0] or 0) <= len(column) or not _is_number(flat.type):
        content.left_out.append(name)
        return
    matrix = _floats(flat).reshape(len(column), lengths[0])
    parts = content.parts.get(name, [])
    named = len(set(parts)) == lengths[0]
    for i in range(lengths[0]):
        content.add(f"{name}.{parts[i]}" if named else f"{name}[{i}]", matrix[:, i])


_NUMBERED = re.compile(r"(.*?)(name|position|velocity|effort)(?:\[|_)?(\d+)\]?$")


def _stamps(columns: Sequence[str], arrays: Mapping[str, NDArray[np.generic]]) -> Floats | None:
    """Return the clock [s] of a table without a header that begins with seconds and nanoseconds, each of shape (n,)."""
    if len(columns) < 2 or not set(columns[:2]) <= set(arrays):
        return None
    seconds, rest = (np.asarray(arrays[c], dtype=float) for c in columns[:2])
    t = seconds - seconds[:1] + 1e-9 * rest
    whole = (
        np.all(seconds == np.round(seconds)) and np.all((rest >= 0) & (rest < 1e9)) and np.any(rest >= 1e3)
    )
    return t if whole and np.all(np.diff(t) >= 0) else None


def _by_header(texts: Mapping[str, str], arrays: Mapping[str, NDArray[np.generic]]) -> dict[str, str]:
    """Return column -> ``<joint>.q .v .u`` where the number of a column is that of a name's."""
    names = {(m[1], m[3]): text for c, text in texts.items() if (m := _NUMBERED.match(c)) and m[2] == "name"}
    found = ((c, _NUMBERED.match(c)) for c in arrays)
    return {
        c: f"{names[m[1], m[3]]}.{JOINT_SIGNALS[m[2]]}"
        for c, m in found
        if m and m[2] in JOINT_SIGNALS and (m[1], m[3]) in names
    }


def _by_order(
    columns: Sequence[str], texts: Mapping[str, str], arrays: Mapping[str, NDArray[np.generic]]
) -> dict[str, str]:
    """Name the numbers behind the last run of names: positions first, then speeds and efforts as far as there are."""
    ends = [i for i, c in enumerate(columns) if c in texts]
    behind = [c for c in columns[ends[-1] + 1 :] if c in arrays] if ends else []
    if not behind or len(ends) < 2 or len(behind) != len(columns) - ends[-1] - 1:
        return {}
    run = [c for i, c in enumerate(columns[: ends[-1] + 1]) if c in texts and ends[-1] - i < len(ends)]
    for names in (run, run[1:]):  # a frame may stand before the names
        groups, rest = divmod(len(behind), max(len(names), 1))
        if names and not rest and 1 <= groups <= 3 and len(set(texts[c] for c in names)) == len(names):
            signals = {1: "q", 3: "qvu"}.get(groups) or ["q", _second(behind, len(names), arrays)]
            joints = [texts[c] for c in names] * groups
            return {
                c: f"{joint}.{signals[k // len(names)]}"
                for k, (c, joint) in enumerate(zip(behind, joints, strict=True))
            }
    return {}


def _second(behind: Sequence[str], joints: int, arrays: Mapping[str, NDArray[np.generic]]) -> str:
    """Return whether the second group is speeds (it goes with the change of the first) or efforts."""
    columns = [np.asarray(arrays[c], dtype=float) for c in behind]
    pairs = zip(columns[:joints], columns[joints:], strict=True)
    alike = [np.corrcoef(np.gradient(q), x)[0, 1] for q, x in pairs if np.ptp(q) > 0 and np.ptp(x) > 0]
    return "v" if alike and float(np.median(alike)) > 0.9 else "u"


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
    needed = (*texts, clock, value)
    columns = {name: np.array(table.column(name).to_pylist(), dtype=object) for name in needed}
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
