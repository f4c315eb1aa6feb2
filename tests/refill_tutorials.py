"""Put what the commands of the tutorials print into their pages: ``python -m tests.refill_tutorials [PAGE...]``.

A shown line that no longer agrees (tests/test_tutorials.py says how) becomes the printed line most like it. Every
change is printed.
"""

from __future__ import annotations

import contextlib
import difflib
import io
import os
import re
import sys
import tempfile
from pathlib import Path

from pinotwin.cli.main import main
from tests.test_tutorials import BLOCK, ROOT, commands, same


def refilled(shown: str, printed: str) -> str:
    """Return a text block with its lines as they are printed now, in their order."""
    lines, at, out = printed.splitlines(), 0, []
    for line in shown.splitlines():
        if line.strip() in ("", "..."):
            out.append(line)
            continue
        rest = range(at, len(lines))
        found = next((k for k in rest if same(line.strip(), lines[k].strip())), None)
        if found is None and rest:
            found = max(rest, key=lambda k: difflib.SequenceMatcher(None, line, lines[k]).ratio())
            sys.stdout.write(f"- {line}\n+ {lines[found]}\n")
            line = lines[found]
        out.append(line)
        at = len(lines) if found is None else found + 1
    return "\n".join(out) + "\n"


def refill(page: Path, folder: Path) -> None:
    """Run a page's commands in a folder and write the page anew."""
    (folder / "examples").mkdir()
    (folder / "examples" / "data").symlink_to(ROOT / "examples" / "data")
    os.chdir(folder)
    printed = ""

    def anew(found: re.Match[str]) -> str:
        nonlocal printed
        language, text = found[1], found[2]
        for arguments in commands(text) if language == "" else []:
            with contextlib.redirect_stdout(io.StringIO()) as out:
                if main(arguments) != 0:
                    raise SystemExit(f"{page.name}: pinotwin {' '.join(arguments)} failed")
            printed = out.getvalue()
        return f"```text\n{refilled(text, printed)}```" if language == "text" else found[0]

    page.write_text(BLOCK.sub(anew, page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    for name in sys.argv[1:] or ("cnc", "robot", "research", "vibration"):
        with tempfile.TemporaryDirectory() as place:
            refill(ROOT / "docs" / f"tutorial_{name}.md", Path(place))
            os.chdir(ROOT)
