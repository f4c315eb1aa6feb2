"""A meshcat window that writes its scene down instead of sending it to a browser.

``meshcat.Visualizer(window=Page())`` draws without a server, a port or a child process. What was
drawn becomes one self-contained HTML page (meshcat's own script inside, no network), or is sent
later to a live window. The commands run in their order; meshcat's own static page fetches each one
by itself, so that they may overtake each other.
"""

from __future__ import annotations

import base64
import html
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import meshcat
import umsgpack

_SCRIPT = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"

_TEMPLATE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>{title}</title>
<style>body {{margin: 0}} #pane {{width: 100vw; height: 100vh; overflow: hidden}} {style}</style>
</head>
<body><div id="pane"></div>
<script>{script}</script>
<script>
var viewer = new MeshCat.Viewer(document.getElementById("pane"));
for (const text of [
{commands}
]) viewer.handle_command_bytearray(Uint8Array.from(atob(text), c => c.charCodeAt(0)));
</script></body></html>
"""


class Command(Protocol):
    """Anything that meshcat can send."""

    def lower(self) -> dict[str, Any]:
        """Return the message as plain data."""


@dataclass(frozen=True)
class Message:
    """A command that is already plain data."""

    data: dict[str, Any]

    def lower(self) -> dict[str, Any]:
        """Return the message as plain data."""
        return self.data


@dataclass(frozen=True)
class Page:
    """A recording of what was drawn; a later command of the same kind replaces the earlier one.

    Attributes:
        messages: (kind, path, property) -> message, in drawing order.
    """

    messages: dict[tuple[str, str, str], dict[str, Any]] = field(default_factory=dict)

    def send(self, command: Command) -> None:
        """Take down one command of meshcat."""
        data = command.lower()
        key = (data["type"], str(data.get("path", "")), str(data.get("property", "")))
        self.messages[key] = data

    def copy(self) -> Page:
        """Return a recording that can be drawn on without changing this one."""
        return Page(dict(self.messages))

    def replay(self, window: Any) -> None:
        """Send everything to another window, for example a live one."""
        for data in self.messages.values():
            window.send(Message(data))

    def html(self, title: str, controls: bool = True) -> str:
        """Return one page that holds everything it needs.

        Args:
            title: title of the page.
            controls: whether to keep meshcat's control panel.
        """
        return _TEMPLATE.format(
            title=html.escape(title),
            style="" if controls else ".dg.main {display: none}",
            script=self.script(),
            commands=self.commands(),
        )

    def script(self) -> str:
        """Return meshcat's own script."""
        return _SCRIPT.read_text(encoding="utf-8")

    def commands(self) -> str:
        """Return the commands as lines of JavaScript, the same in every run.

        Meshcat gives every shape a random name (UUID); here they are numbered in the order of drawing.
        """
        known: dict[str, str] = {}
        packed = (umsgpack.packb(_numbered(m, known)) for m in self.messages.values())
        return ",\n".join(f'"{base64.b64encode(m).decode()}"' for m in packed)


_UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


def _numbered(value: Any, known: dict[str, str]) -> Any:
    """Return a message with every UUID replaced by the number of its first appearance."""
    if isinstance(value, dict):
        return {key: _numbered(x, known) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [_numbered(x, known) for x in value]
    if isinstance(value, str) and _UUID.fullmatch(value):
        return known.setdefault(value, f"00000000-0000-0000-0000-{len(known) + 1:012x}")
    return value
