"""Writes a servo log in the look of what controllers and tools export; nothing here is a vendor's file.

Every function takes SI channels (``t``, ``<axis>.q``, ``.qr``, ``.u``) and the axes that turn, and returns
the bytes of one export. The layouts imitate, byte for byte, header blocks, delimiters, decimal signs,
encodings and line ends; ``tests/test_vendor_files.py`` reads them back.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping

import numpy as np

Channels = Mapping[str, np.ndarray]

CURRENT = {"Y": 4.0, "A": 0.5}
"""Amperes of the drive's current for one N or N·m."""


def axes(log: Channels) -> list[str]:
    return [name[:-2] for name in log if name.endswith(".q")]


def _mm(x: np.ndarray, rotary: bool) -> np.ndarray:
    return np.rad2deg(x) if rotary else 1e3 * x


def _rows(columns: list[np.ndarray], delimiter: str, decimal: str, form: str = "%.6f") -> list[str]:
    return [delimiter.join(form % x for x in row).replace(".", decimal) for row in zip(*columns, strict=True)]


def _drive(log: Channels, rotary: set[str]) -> list[tuple[str, str, str, np.ndarray]]:
    """Return (axis, signal, unit, values): commands and positions in mm or degrees, current in A."""
    out = []
    for a in axes(log):
        unit = "deg" if a in rotary else "mm"
        out.append((a, "qr", unit, _mm(log[f"{a}.qr"], a in rotary)))
        out.append((a, "q", unit, _mm(log[f"{a}.q"], a in rotary)))
        out.append((a, "u", "A", log[f"{a}.u"] * CURRENT.get(a, 1.0)))
    return out


def tnc_scope(log: Channels, rotary: set[str]) -> bytes:
    """Latin-1, semicolons, decimal commas, six header lines, a row of units."""
    words = {"qr": "s soll", "q": "s ist", "u": "I ist"}
    signals = _drive(log, rotary)
    step = 1e3 * float(log["t"][1] - log["t"][0])
    head = [
        "TNCscope;Aufzeichnung",
        "Steuerung;iTNC 530;340490-08",
        "Datum;22.11.2026;14:03:12",
        f"Abtastzeit;{step:g} ms;".replace(".", ","),
        f"Anzahl Kanäle;{len(signals)}",
        "Kommentar;Kreisformtest Rundtisch, 20 °C",
        "Zeit;" + ";".join(f"{words[kind]} {a}" for a, kind, _, _ in signals),
        "[ms];" + ";".join({"deg": "[°]"}.get(unit, f"[{unit}]") for _, _, unit, _ in signals),
    ]
    rows = _rows([1e3 * log["t"], *(x for *_, x in signals)], ";", ",")
    return ("\r\n".join(head + rows) + "\r\n").encode("latin-1")


def tnc_scope_own(log: Channels, rotary: set[str]) -> bytes:
    """TNCscope's own grammar: a block of ``%KEY=value`` a curve, time in us, a semicolon behind every number."""
    words = {"qr": "s soll", "q": "s ist", "u": "I ist"}
    signals = _drive(log, rotary)
    step = f"{1e6 * float(log['t'][1] - log['t'][0]):.0f}"
    head = [
        "%TNCscopeNT data file",
        "% ",
        "%[GLOBAL]",
        "%VERSION=2.0",
        "%CONTROL=iTNC530",
        f"%SAMPLING={step}",
        "% ",
    ]
    for k, (a, kind, unit, _) in enumerate(signals, 1):
        keys = {
            "NAME": f"{words[kind]}/{a}",
            "CHANNELTYPE": words[kind],
            "AXISTYPE": a,
            "DIMENSION": {"A": "Ampere", "deg": "Grad"}.get(unit, unit),
            "COUNT": str(len(log["t"])),
            "SAMPLING": step,
            "CYCLETIME": "100" if kind == "u" else step,
            "COLOR": "255 0 0",
            "COLUMN": str(k),
            "NUMSYS": "d",
        }
        head += [f"%[CURVE{k}]", *(f"%{key}={value}" for key, value in keys.items()), "% "]
    columns = [1e6 * log["t"], *(x for *_, x in signals)]
    rows = [f"{'; '.join(f'{x:16.9e}' for x in row)}; " for row in zip(*columns, strict=True)]
    return ("\r\n".join([*head, "%[DATA]", *rows]) + "\r\n").encode("latin-1")


def halscope(log: Channels, rotary: set[str]) -> bytes:
    """LinuxCNC's halscope: the sampling period, then every value behind its pin's name; decimal commas."""
    pins = {"qr": "joint.{}.motor-pos-cmd", "q": "joint.{}.motor-pos-fb", "u": "cia402.{}.actual-torque"}
    columns = [(pins[kind].format(a), log[f"{a}.{kind}"]) for a in axes(log) for kind in pins]
    head = [f"Sampling period is {1e9 * (log['t'][1] - log['t'][0]):.0f} nSec ", ""]
    rows = [
        "".join(f"{pin} {x[i]:+.14f} " for pin, x in columns).replace(",", "") for i in range(len(log["t"]))
    ]
    return ("\n".join([*head, *(re.sub(r"(\d)\.(\d)", r"\1,\2", row) for row in rows)]) + "\n").encode()


def mr_configurator(log: Channels, rotary: set[str]) -> bytes:
    """MR Configurator's graph: slots over signals, unused ones named ``Not selected``; all in SI."""
    words = {"qr": "Command position", "q": "Feedback position", "u": "Torque"}
    signals = [(f"{words[kind]} {a}", log[f"{a}.{kind}"]) for a in axes(log) for kind in words]
    slots = ["Time", *(f"Analog {k}" for k in range(1, len(signals) + 2)), "Digital 1", "Digital 2"]
    titles = ["ms", *(title for title, _ in signals), "Not selected", "INP", "Not selected"]
    step = 1e3 * float(log["t"][1] - log["t"][0])
    head = ["Axis1", f"Number of sampling data,{len(log['t'])}", f"Sampling time interval(ms),{step:.3f}"]
    rest = [np.zeros(len(log["t"])), 2.5 + 0.0 * log["t"], np.zeros(len(log["t"]))]
    rows = _rows([1e3 * log["t"], *(x for _, x in signals), *rest], ",", ".", "%.8f")
    return ("\r\n".join([*head, ",".join(slots), ",".join(titles), *rows]) + "\r\n").encode()


def daq(log: Channels, rotary: set[str]) -> bytes:
    """A data logger: rows that say what they hold before every clock, a clock a channel."""
    signals = _drive(log, rotary)
    step = log["t"][1] - log["t"][0]
    labels = {
        "Timestamp": lambda s: "2020-03-16 17:04:51",
        "Interval": lambda s: f"{step:g}",
        "Channel name": lambda s: f'"{s[0]} {s[1]}"',
        "Unit": lambda s: f'"{s[2]}"',
    }
    head = [",".join(f"{label},{say(s)}" for s in signals) for label, say in labels.items()]
    rows = [",".join(f"{t:.6g},{x[i]:.9g}" for *_, x in signals) for i, t in enumerate(log["t"])]
    return ("\n".join([*head, *rows]) + "\n").encode()


def sinumerik(log: Channels, rotary: set[str]) -> bytes:
    """Semicolons, decimal commas, a block with the table of signals, ``Grad`` as unit, no time column."""
    words = {"qr": "Lagesollwert", "q": "Lageistwert", "u": "Strom-Istwert"}
    signals = _drive(log, rotary)
    step = 1e3 * float(log["t"][1] - log["t"][0])
    head = [
        "SINUMERIK Operate;Trace",
        "Datei;TRACE_001",
        "Erstellt;22.11.2026 14:03:12",
        f"Abtastzeit [ms];{step:g}".replace(".", ","),
        "",
        "Nr;Signal;Achse;Einheit",
    ]
    for i, (a, kind, unit, _) in enumerate(signals, 1):
        head.append(f"{i};{words[kind]};{a};{'Grad' if unit == 'deg' else unit}")
    head += ["", ";".join(f"{words[kind]}.{a}" for a, kind, _, _ in signals) + ";"]
    rows = [row + ";" for row in _rows([x for *_, x in signals], ";", ",")]
    return ("\r\n".join(head + rows) + "\r\n").encode("utf-8-sig")


def twincat(log: Channels, rotary: set[str], slower: int = 1) -> bytes:
    """Tabs, a clock per channel, 15 labelled rows, an end mark; ``slower``: stride of the last channel."""
    words = {"qr": "SetPos", "q": "ActPos", "u": "ActTorque"}
    signals = _drive(log, rotary)
    step = 1e3 * float(log["t"][1] - log["t"][0])
    labels = {
        "SymbolComment": lambda s: "",
        "Data-Type": lambda s: "REAL64",
        "SampleTime[ms]": lambda s: f"{step:g}",
        "VariableSize": lambda s: "8",
        "SymbolBased": lambda s: "True",
        "IndexGroup": lambda s: "16448",
        "SymbolName": lambda s: f"Axes.{s[0]}.{words[s[1]]}",
        "NetID": lambda s: "5.12.34.56.1.1",
        "Port": lambda s: "501",
        "Offset": lambda s: "0",
        "ScaleFactor": lambda s: "1",
        "BitMask": lambda s: "0xffffffffffffffff",
        "Unit": lambda s: {"deg": "deg (Angle)", "mm": "mm (Length)", "A": "A (Current)"}[s[2]],
        "Unit ScaleFactor": lambda s: "1",
        "Unit Offset": lambda s: "0",
    }
    head = [
        "Name\tServo trace",
        "File\tC:\\scope\\servo trace.csv",
        "Starttime of export\t132959733843760000\tSonntag, 22. November 2026\t14:03:12.376",
        "",
        "",
        "\t".join(f"Name\t{a} {words[kind]}" for a, kind, _, _ in signals),
    ]
    head += ["\t".join(f"{label}\t{say(s)}" for s in signals) for label, say in labels.items()]
    lines = [*head, ""]
    t = 1e3 * log["t"]
    for i in range(len(t)):
        cells = []
        for k, (*_, x) in enumerate(signals):
            at = i * slower if k == len(signals) - 1 else i
            cells += [f"{t[at]:g}", f"{x[at]:.7g}"] if at < len(t) else [" ", " "]
        lines.append("\t".join(cells))
    return ("\r\n".join([*lines, "EOF"]) + "\r\n").encode()


def halsampler(log: Channels, rotary: set[str]) -> bytes:
    """Blanks, no header, a running number first, a mark where samples were lost; machine units."""
    signals = _drive(log, rotary)
    rows = [f"{i} " + " ".join(f"{x[i]:f}" for *_, x in signals) + " " for i in range(len(log["t"]))]
    return ("\n".join(rows) + "\n").encode()


def fanuc(log: Channels, rotary: set[str]) -> bytes:
    """Commas, a block of ``key,value``, channel titles with units in brackets, ``mm`` and ``%``."""
    step = 1e3 * float(log["t"][1] - log["t"][0])
    words = {"qr": "POSC", "q": "POSF", "u": "TCMD"}
    signals = _drive(log, rotary)
    head = [
        "SERVO GUIDE,Graph data",
        "Date,2026/11/22,14:03:12",
        f"Sampling cycle,{step:g},msec",
        f"Data points,{len(log['t'])}",
        "TIME(msec)," + ",".join(f"{words[kind]}-{a}({unit})" for a, kind, unit, _ in signals),
    ]
    rows = _rows([1e3 * log["t"], *(x for *_, x in signals)], ",", ".")
    return ("\r\n".join(head + rows) + "\r\n").encode()


def excel(log: Channels, rotary: set[str]) -> bytes:
    """``sep=;``, two title lines, quoted thousands: what a spreadsheet saves."""
    names = {"qr": "Command", "q": "Actual", "u": "Current"}
    signals = _drive(log, rotary)
    head = ["sep=;", "Servo trace of the Y axis, week 47;", ";"]
    head.append("Time [s];" + ";".join(f"{a} {names[kind]} [{unit}]" for a, kind, unit, _ in signals))
    rows = [
        ";".join([f"{log['t'][i]:.4f}", *(f"{x[i]:,.6f}" for *_, x in signals)]) for i in range(len(log["t"]))
    ]
    return ("\r\n".join(head + rows) + "\r\n").encode("utf-8-sig")


def lerobot(log: Channels, rotary: set[str]) -> bytes:
    """Lists in cells: state and action of all joints in one column each."""
    named = axes(log)
    rows = ["timestamp,observation.state,observation.effort,action"]
    for i, t in enumerate(log["t"]):
        lists = [[round(float(log[f"{a}.{kind}"][i]), 7) for a in named] for kind in ("q", "u", "qr")]
        rows.append(",".join([f"{t:.4f}", *(f'"{x}"' for x in lists)]))
    return ("\n".join(rows) + "\n").encode()


def _clock_times(log: Channels) -> list[str]:
    """ISO stamps in UTC, over the end of a day."""
    start = np.datetime64("2026-03-01T23:59:59.500", "us")
    return [f"{start + np.timedelta64(round(1e6 * float(t)), 'us')}Z" for t in log["t"]]


def opcua(log: Channels, rotary: set[str]) -> bytes:
    """An OPC UA historian: one value a row, node ids, decimal commas, a status; a state among the numbers."""
    rows = ["NodeId;DisplayName;SourceTimestamp;ServerTimestamp;Value;StatusCode"]
    names = [f"{a}.{kind}" for a in axes(log) for kind in ("qr", "q", "u")]
    for i, stamp in enumerate(_clock_times(log)):
        for name in names:
            value = f"{log[name][i]:.9f}".replace(".", ",")
            rows.append(f'"ns=2;s={name}";{name[2:]};{stamp};{stamp};{value};Good')
        if i % 100 == 0:
            rows.append(f'"ns=2;s=Program";Program;{stamp};{stamp};O{i:04d};Good')
    return ("\r\n".join(rows) + "\r\n").encode("utf-8-sig")


def mtconnect(log: Channels, rotary: set[str]) -> bytes:
    """An MTConnect adapter's lines: a stamp, then the items that changed; what is not known is UNAVAILABLE."""
    names = [f"{a}.{kind}" for a in axes(log) for kind in ("qr", "q", "u")]
    rows, last = [], dict[str, str]()
    for i, stamp in enumerate(_clock_times(log)):
        now = {name: f"{log[name][i]:.9f}" for name in names} | {"avail": "AVAILABLE"}
        changed = {name: value for name, value in now.items() if last.get(name) != value}
        rows.append("|".join([stamp, *(f"{name}|{value}" for name, value in changed.items())]))
        last = now
    return ("\n".join(rows) + "\n").encode()


def plotjuggler(log: Channels, rotary: set[str]) -> bytes:
    """PlotJuggler: ``__time`` from 1970, a row holds the topics that came then, cells of the others are empty."""
    states = [
        (f"/joint_states/{a}/{word}", log[f"{a}.{kind}"]) for a in axes(log) for kind, word in _STATE.items()
    ]
    commands = [(f"/command/{a}/reference", log[f"{a}.qr"]) for a in axes(log)]
    rows = [",".join(["__time", *(name for name, _ in [*states, *commands])])]
    for i, t in enumerate(log["t"]):
        rows.append(
            ",".join([f"{1.7e9 + t:.6f}", *(f"{x[i]:.9f}" for _, x in states), *("" for _ in commands)])
        )
        rows.append(
            ",".join([f"{1.7e9 + t:.6f}", *("" for _ in states), *(f"{x[i]:.9f}" for _, x in commands)])
        )
    return ("\n".join(rows) + "\n").encode()


_STATE = {"q": "position", "u": "effort"}


def json_rows(log: Channels, rotary: set[str]) -> bytes:
    """One document with settings and a list of messages with a list of joint names (JointState)."""
    return json.dumps({"robot": "two joints", "kp": 7.5, "entries": _joint_states(log)}).encode()


def json_columns(log: Channels, rotary: set[str]) -> bytes:
    """One document of columns."""
    return json.dumps({name: [round(float(v), 9) for v in x] for name, x in log.items()}).encode()


def json_lines(log: Channels, rotary: set[str]) -> bytes:
    """One message a line."""
    return "".join(json.dumps(message) + "\n" for message in _joint_states(log)).encode()


def _joint_states(log: Channels) -> list[dict[str, object]]:
    named = axes(log)[::-1]  # not the order of the machine: the names say which is which
    return [
        {
            "t": round(float(log["t"][i]), 9),
            "name": named,
            "position": [round(float(log[f"{a}.q"][i]), 9) for a in named],
            "effort": [round(float(log[f"{a}.u"][i]), 9) for a in named],
        }
        for i in range(len(log["t"]))
    ]


FORMATS: dict[str, tuple[str, Callable[[Channels, set[str]], bytes]]] = {
    "tnc_scope": (".csv", tnc_scope),
    "tnc_scope_own": (".sco", tnc_scope_own),
    "halscope": (".log", halscope),
    "mr_configurator": (".csv", mr_configurator),
    "daq": (".csv", daq),
    "sinumerik": (".csv", sinumerik),
    "twincat": (".csv", twincat),
    "halsampler": (".txt", halsampler),
    "fanuc": (".csv", fanuc),
    "excel": (".csv", excel),
    "lerobot": (".csv", lerobot),
    "opcua": (".csv", opcua),
    "mtconnect": (".txt", mtconnect),
    "plotjuggler": (".csv", plotjuggler),
    "json_rows": (".json", json_rows),
    "json_columns": (".json", json_columns),
    "json_lines": (".jsonl", json_lines),
}
