"""Style and script of the pages, from the files beside this one."""

from __future__ import annotations

from importlib.resources import files

CSS, SCRIPT = ((files(__package__) / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
