"""Where a page comes from: version, date, options, time taken, the logs with their hashes; and what lies beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote

from pinotwin.report import display
from pinotwin.report.blocks import Block, Html, escape, table


def provenance_blocks(given: Mapping[str, Any]) -> list[Block]:
    """Return the provenance of a result as two tables; nothing where none is known."""
    if not given:
        return []
    facts = [("pinotwin", given.get("version", "")), ("machine", given.get("machine", ""))]
    if given.get("date"):
        facts.append(("made", given["date"]))
    if given.get("seconds_taken") is not None:
        facts.append(("took", display.seconds(float(given["seconds_taken"]))))
    facts += [(str(k).replace("_", " "), _said(v)) for k, v in dict(given.get("options", {})).items()]
    twin = given.get("twin_from")
    if twin:
        facts.append(("twin identified from", ", ".join(str(row.get("source", "")) for row in twin)))
    out: list[Block] = [Html(f'<dl class="facts">{"".join(_fact(k, v) for k, v in facts)}</dl>')]
    rows = [
        [
            row.get("source", ""),
            row.get("role", ""),
            row.get("rows", ""),
            "" if row.get("seconds") is None else display.seconds(float(row["seconds"])),
            Html(f'<span class="mono">{escape(_hash(row))}</span>'),
        ]
        for row in given.get("logs", ())
    ]
    if rows:
        out.append(table(("log", "used as", "rows", "length", "SHA-256 of the file"), rows, numeric=(2, 3)))
    return out


def _fact(name: str, value: object) -> str:
    return f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"


def _said(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value)) or "none"
    return str(value)


def _hash(row: Mapping[str, Any]) -> str:
    whole = row.get("sha256")
    return f"{str(whole)[:16]}…" if whole else f"numbers: {row.get('fingerprint', '')}"


def files_block(files: Sequence[tuple[str, str]]) -> list[Block]:
    """Return links to what lies beside the page.

    Args:
        files: name of each, relative to the page, and what it holds.
    """
    if not files:
        return []
    rows = [[Html(f'<a href="{quote(name)}">{escape(name)}</a>'), what] for name, what in files]
    return [table(("file", "what it holds"), rows)]
