"""A meshcat window that writes its scene down instead of sending it to a browser.

``meshcat.Visualizer(window=Page())`` draws without a server, a port or a child process. What was
drawn becomes one self-contained HTML page (meshcat's own script inside, no network), or is sent
later to a live window. The commands run in their order; meshcat's own static page fetches each one
by itself, so that they may overtake each other.
"""

from __future__ import annotations

import base64
import html
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
        packed = (base64.b64encode(umsgpack.packb(m)).decode() for m in self.messages.values())
        return _TEMPLATE.format(
            title=html.escape(title),
            style="" if controls else ".dg.main {display: none}",
            script=_SCRIPT.read_text(encoding="utf-8"),
            commands=",\n".join(f'"{text}"' for text in packed),
        )
