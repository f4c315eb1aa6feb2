"""Make the pages of the gallery in out/gallery: the demo, and what its twins and logs give; ``make docs`` runs it."""

from __future__ import annotations

from pathlib import Path

from pinotwin.cli.demo import run as demo
from pinotwin.cli.main import main

OUT = Path("out/gallery")
COMMANDS = (
    "simulate {out}/twin {out}/unseen.csv --out {out}/predicted.csv --report {out}/simulation.html",
    "identify trunnion {out}/worn.csv --no-loop --out {out}/twin_worn",
    "compare {out}/twin {out}/twin_worn --log {out}/unseen.csv --out {out}/compared",
    "diagnose {out}/twin --each {out}/unseen.csv {out}/worn.csv --out {out}/each",
    "study {out}/twin {out}/log.csv --only without errors --out {out}/study",
)


def make(out: Path = OUT) -> None:
    """Make the pages, unless they are there; RuntimeError where a command fails."""
    if (out / "study" / "study.html").is_file():
        return
    codes = [demo(out=str(out)).code]
    codes += [main([word.format(out=out) for word in text.split()]) for text in COMMANDS]
    if any(codes):
        raise RuntimeError(f"the gallery is not whole: exit codes {codes}")


if __name__ == "__main__":
    make()
