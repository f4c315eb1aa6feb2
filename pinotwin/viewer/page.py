"""A meshcat window that writes its scene down instead of sending it to a browser: no server, port or child process.

The page is self-contained. Commands run in their order; on meshcat's own static page they may overtake each other.
"""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import meshcat
import umsgpack

from pinotwin.arrays import mapped

_SCRIPT = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"


@dataclass(frozen=True)
class Page:
    """A recording of what was drawn, (kind, path, property) -> message; a later one of the same kind replaces it."""

    messages: dict[tuple[str, str, str], dict[str, Any]] = field(default_factory=dict)

    def send(self, command: Any) -> None:
        """Take down one command of meshcat."""
        self.take(command.lower())

    def take(self, data: dict[str, Any]) -> None:
        """Take down one message."""
        key = (data["type"], str(data.get("path", "")), str(data.get("property", "")))
        self.messages[key] = data

    def copy(self) -> Page:
        """Return a recording that can be drawn on without changing this one."""
        return Page(dict(self.messages))

    def script(self) -> str:
        """Return meshcat's own script, packed."""
        return _packed(_SCRIPT.read_bytes())

    def commands(self) -> tuple[str, str]:
        """Return all commands as one compressed text, the same in every run, and each as pieces of it in JSON."""
        pool, held, known = bytearray(), dict[bytes, list[int]](), dict[str, str]()
        commands = []
        for message in self.messages.values():
            packed, at, pieces = umsgpack.packb(mapped(message, lambda x: _numbered(x, known))), 0, []
            for array in _arrays(message):
                begin = packed.index(array, at)
                pieces += [packed[at:begin], array]
                at = begin + len(array)
            commands.append([_kept(piece, pool, held) for piece in [*pieces, packed[at:]]])
        return _packed(bytes(pool)), json.dumps(commands, separators=(",", ":"))


def _packed(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()


def _kept(piece: bytes, pool: bytearray, held: dict[bytes, list[int]]) -> list[int]:
    """Return begin and end of some bytes in the pool, which takes them where they are new."""
    if piece not in held:
        held[piece] = [len(pool), len(pool) + len(piece)]
        pool += piece
    return held[piece]


def _arrays(value: Any, least: int = 64) -> Iterator[bytes]:
    """Yield the bytes of every array of a message of at least so many bytes, in its order."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for item in value:
            yield from _arrays(item, least)
    elif isinstance(value, umsgpack.Ext) and len(value.data) >= least:
        yield value.data


_UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


def _numbered(value: Any, known: dict[str, str]) -> Any:
    """Return a text, but for a UUID the number of its first appearance."""
    if isinstance(value, str) and _UUID.fullmatch(value):
        return known.setdefault(value, f"00000000-0000-0000-0000-{len(known) + 1:012x}")
    return value
