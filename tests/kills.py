"""Kill every command at a random moment, fill its disk, forbid its folder: nothing earlier may be lost.

    python -m tests.kills [--count 200] [--seed 0] [--command record ...]

Each command has a result of an earlier run and is run again on another input. Killed (SIGKILL, half of the times
while it ends), its artefacts must be those of the earlier run or those of the new one, whole, never a mixture; what
the killed process left must be gone after the next run. With a disk that is full after a few bytes, and in a folder
that may not be written to, it must say so in one line with exit code 2 and keep the earlier result.

The commands run in children forked from this process, in which everything is imported and compiled already.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import hashlib
import json
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pinotwin.cli.main import COMMANDS, main
from tests.rig import good_log, write_log, write_machine

NOBODY = 65534
SMALL = 2000  # bytes that a full disk still takes
EACH = ("mon", "tue", "wed")


@dataclass(frozen=True)
class Command:
    """One command: its words for an input 0 or 1 (``--json`` is added), and the names of its artefacts."""

    words: Callable[[int], Sequence[str]]
    artefacts: tuple[str, ...]
    fresh: bool = False  # refuses a place that is taken: each run has a new one
    own: bool = False  # needs an interpreter of its own: threads of Dask do not live on in a fork


def commands() -> Mapping[str, Command]:
    """Return the commands, their words relative to a folder made by :func:`prepared`."""
    out = {
        "new": Command(lambda k: ["new", "XZ" if k else "XY", "--out", "out"], ("out",), fresh=True),
        "check": Command(lambda k: ["check", "rig", f"{k}.csv"], ()),
        "identify": Command(lambda k: ["identify", "rig", f"{k}.csv", "--no-loop", "--out", "out"], ("out",)),
        "simulate": Command(lambda k: ["simulate", "looped", f"e{k}.csv", "--out", "out.csv"], ("out.csv",)),
        "update": Command(lambda k: ["update", "twin", f"{k}.csv", "--out", "out"], ("out",)),
        "improve": Command(
            lambda k: [
                "improve",
                "rig",
                f"{k}.csv",
                "--validate",
                f"{1 - k}.csv",
                "--most",
                "1",
                "--out",
                "out",
            ],
            ("out",),
        ),
        "diagnose": Command(lambda k: ["diagnose", "twin", f"{k}.csv", "--quick", "--out", "out"], ("out",)),
        "each": Command(each_words, ("out",), own=True),
        "force": Command(lambda k: ["force", "twin", f"{k}.csv", "--out", "out.csv"], ("out.csv",)),
        "study": Command(
            lambda k: ["study", "rig", f"{k}.csv", "--only", "amount", "--out", "out"], ("out",)
        ),
        "compare": Command(
            lambda k: ["compare", "twin", "other", "--log", f"{k}.csv", "--out", "out"], ("out",)
        ),
        "blind": Command(
            lambda k: [
                *("blind", "--machines", "emps", "--situations", "structure", "--cases", "1", "--quick"),
                *("--seconds", "4", "--workers", "1", "--seed", str(k), "--out", "out"),
            ],
            ("out/bench.md", "out/bench.html"),
        ),
        "vibration": Command(
            lambda k: [
                *("vibration", "flexure_rig", "--servo", f"s{k}.csv", "--imu", f"i{k}.csv"),
                *("--out", "out.csv", "--report", "out.html"),
            ],
            ("out.csv", "out.html"),
        ),
        "orientation": Command(
            lambda k: ["orientation", f"i{k}.csv", "--out", "out.csv", "--report", "out.html"],
            ("out.csv", "out.html"),
        ),
        "record": Command(
            lambda k: ["record", "emps", "--seconds", "3", "--seed", str(k), "--out", "out.csv"], ("out.csv",)
        ),
        "view": Command(lambda k: ["view", "rig", f"{k}.csv", "--html", "out.html"], ("out.html",)),
        "export": Command(
            lambda k: ["export", "other" if k else "twin", "--format", "numpy", "--out", "out.py"],
            ("out.py",),
        ),
    }
    missing = set(COMMANDS) - set(out) - {"demo"}  # demo runs the others
    assert not missing, missing
    return out


def each_words(k: int) -> Sequence[str]:
    """Return the words of ``--each`` over logs of the same names for both inputs: else it keeps what it has."""
    logs = [f"each{k}/{name}.csv" for name in EACH]
    return ["diagnose", "twin", "--each", *logs, "--quick", "--workers", "1", "--out", "out"]


def prepared(folder: Path) -> Path:
    """Write the inputs of all commands: a machine, two logs of it, two twins, two logs of the rig with an IMU."""
    write_machine(folder / "rig")
    log = good_log()
    write_log(folder / "0.csv", log)
    write_log(folder / "1.csv", {**log, "X.u": 1.02 * log["X.u"]})
    for k, stronger in enumerate((1.0, 1.02)):
        (folder / f"each{k}").mkdir()
        for n, name in enumerate(EACH):
            write_log(folder / f"each{k}" / f"{name}.csv", {**log, "X.u": (stronger + 0.01 * n) * log["X.u"]})
    ran("identify", "rig", "0.csv", "--no-loop", "--out", "twin", cwd=folder)
    ran("identify", "rig", "1.csv", "--no-loop", "--out", "other", cwd=folder)
    for k in "01":
        ran("record", "emps", "--seconds", "6", "--seed", k, "--out", f"e{k}.csv", cwd=folder)
    ran("identify", "emps", "e0.csv", "--out", "looped", cwd=folder)
    for k in "01":
        more = ("--imu", f"i{k}.csv", "--imu-link", "C_link", "--seed", k)
        ran("record", "flexure_rig", "--seconds", "8", "--out", f"s{k}.csv", *more, cwd=folder)
    return folder


def ran(*words: str, cwd: Path) -> None:
    code, said = finished(forked(words, cwd))
    assert code == 0, (words, said)


def warmed(words: Sequence[str], cwd: Path) -> None:
    """Run a command here, so that the children have all modules and compiled functions."""
    with (
        contextlib.chdir(cwd),
        open(os.devnull, "w") as sink,
        contextlib.redirect_stdout(sink),
        contextlib.redirect_stderr(sink),
    ):
        main(list(words))


@dataclass(frozen=True)
class Child:
    """A command in a process of its own, its words to stderr in a file."""

    pid: int
    errors: Path


def forked(
    words: Sequence[str], cwd: Path, before: Callable[[], None] | None = None, own: bool = False
) -> Child:
    """Start a command in a child of this process, or in an interpreter of its own."""
    errors = Path(tempfile.mkstemp(suffix=".stderr")[1])
    pid = os.fork()
    if pid:
        return Child(pid, errors)
    code = 99
    try:
        os.setsid()
        os.chdir(cwd)
        for stream, name in ((1, os.devnull), (2, str(errors))):
            os.dup2(os.open(name, os.O_WRONLY), stream)
        sys.stdout, sys.stderr = (os.fdopen(n, "w", closefd=False) for n in (1, 2))  # a test has its own
        if before is not None:
            before()
        if own:
            os.execv(sys.executable, [sys.executable, "-m", "pinotwin.cli.main", *words])
        code = main(list(words))
        sys.stderr.flush()
    except SystemExit as stop:
        code = int(stop.code or 0)
    except Exception:  # noqa: BLE001 - a traceback is what is looked for
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


def finished(
    child: Child, kill_after: float | None = None, how: signal.Signals = signal.SIGKILL
) -> tuple[int, str]:
    """Return a child's exit code (negative: the signal) and what it said, killed after some seconds [s]."""
    end = None if kill_after is None else time.monotonic() + kill_after
    while True:
        pid, status = os.waitpid(child.pid, os.WNOHANG)
        if pid:
            break
        if end is not None and time.monotonic() > end:
            os.kill(child.pid, how)
            end = None
        time.sleep(0.002)
    said = child.errors.read_text(errors="replace")
    child.errors.unlink()
    return os.waitstatus_to_exitcode(status), said


def state(folder: Path, artefacts: Sequence[str]) -> dict[str, str]:
    """Return what the artefacts hold: name -> digest, times and temporary places left out."""
    out = {}
    for name in artefacts:
        place = folder / name
        for file in sorted(place.rglob("*")) if place.is_dir() else [place]:
            if file.is_file():
                out[file.relative_to(folder).as_posix()] = hashlib.sha256(_timeless(file)).hexdigest()
    return out


def _timeless(file: Path) -> bytes:
    content = file.read_bytes()
    if file.suffix == ".json" and content.endswith(b"}\n"):
        return json.dumps(_without_times(json.loads(content))).encode()
    return re.sub(rb"<dt>(made|took)</dt><dd>[^<]*", b"", content)  # of a report


def _without_times(value: object) -> object:
    if isinstance(value, dict):
        return {
            k: _without_times(v)
            for k, v in value.items()
            if k not in ("seconds", "seconds_taken", "date", "kept_of_an_earlier_run")
        }
    return [_without_times(v) for v in value] if isinstance(value, list) else value


def litter(folder: Path) -> list[str]:
    """Return what is left of processes that ended in the middle."""
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob(".*") if ".part" in p.name)


class Attack:
    """One command with the result of an earlier run (input 0), attacked while it is run on input 1."""

    def __init__(self, name: str, inputs: Path, folder: Path) -> None:
        self.command, self.folder = commands()[name], folder
        shutil.copytree(inputs, folder, dirs_exist_ok=True)
        folder.chmod(0o755)
        self.states, self.seconds = [], 0.0
        if not self.command.own:
            warmed(self.command.words(0), folder)
        for k in (1, 0):
            start = time.monotonic()
            code, said = finished(self.start(k))
            assert code == 0, (name, code, said)
            self.seconds = time.monotonic() - start
            self.states.insert(0, state(folder, self.artefacts))

    @property
    def artefacts(self) -> tuple[str, ...]:
        """Names of what the command leaves; the folder of its ``--json`` is made by it."""
        return (*self.command.artefacts, "made/here/result.json")

    def start(self, k: int, before: Callable[[], None] | None = None) -> Child:
        if self.command.fresh:
            for place in ("out", "made"):
                shutil.rmtree(self.folder / place, ignore_errors=True)
        words = [*self.command.words(k), "--json", "made/here/result.json"]
        return forked(words, self.folder, before, self.command.own)

    def kill(self, rng: random.Random) -> Counter[str]:
        """Kill the command once and say what became of the artefacts."""
        code, _ = finished(self.start(1), kill_after=moment(rng) * self.seconds)
        found = Counter(kills=int(code == -signal.SIGKILL), ended=int(code == 0))
        old, new = self.states
        now = state(self.folder, self.artefacts)
        if self.command.fresh:
            old = {}
        for artefact in self.artefacts:
            a, b, c = (_of(s, artefact) for s in (old, new, now))
            found[verdict(a, b, c)] += 1
        if now != old:  # the earlier result again
            finished(self.start(0))
        return found

    def tidy(self) -> Counter[str]:
        """Run once more and count what lies about."""
        code, _ = finished(self.start(0))
        assert code == 0
        return Counter(
            litter=len(litter(self.folder)), lost=int(state(self.folder, self.artefacts) != self.states[0])
        )

    def full_disk(self) -> Counter[str]:
        """Run on a disk that is full after a few bytes."""

        return self._refused(fill_disk)

    def forbidden(self) -> Counter[str]:
        """Run as somebody who may not write here (root may write anywhere)."""
        if os.getuid() != 0:
            return Counter()
        if not self.command.own:
            return self._refused(lambda: os.setuid(NOBODY))
        owned_by(self.folder, NOBODY)  # an interpreter of its own may lie where only root can start it
        try:
            return self._refused(no_override)
        finally:
            owned_by(self.folder, 0)

    def _refused(self, before: Callable[[], None]) -> Counter[str]:
        small = all(
            (self.folder / name).stat().st_size < SMALL
            for name in self.states[1]
            if "/" not in name and (self.folder / name).is_file()
        )
        code, said = finished(self.start(1, before))
        now = state(self.folder, self.artefacts)
        old = {} if self.command.fresh else self.states[0]
        verdicts = {verdict(*(_of(one, a) for one in (old, self.states[1], now))) for a in self.artefacts}
        kept = verdicts <= {"old kept", "new", "earlier"}
        one_line = in_one_line(code, said)
        return Counter(
            refused=1,
            lost=int(not kept),
            litter=len(litter(self.folder)),
            tracebacks=int(not (one_line or (small and code == 0))),
        )


def moment(rng: random.Random) -> float:
    """Return when to kill, as a share of the time that the command takes: half of the times while it ends."""
    late = rng.random() < 0.5
    return rng.uniform(0.85, 1.05) if late else rng.uniform(0.0, 1.0)


def in_one_line(code: int, said: str) -> bool:
    """Whether a command was refused as promised; what it said instead is printed."""
    if code == 2 and said.count("\n") == 1 and said.startswith("pinotwin: "):
        return True
    print(f"exit code {code}: {said[-600:]}")
    return False


def fill_disk() -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (SMALL, SMALL))


def owned_by(folder: Path, user: int) -> None:
    for place in (folder, *folder.rglob("*")):
        os.chown(place, user, -1)


def no_override() -> None:
    """Give up root's power to write where it has no right to, in all that this process starts."""
    drop, dac_override = 24, 1  # PR_CAPBSET_DROP, CAP_DAC_OVERRIDE of linux/prctl.h and capability.h
    if ctypes.CDLL(None, use_errno=True).prctl(drop, dac_override, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "prctl")


def _of(found: Mapping[str, str], artefact: str) -> dict[str, str]:
    return {k: v for k, v in found.items() if k == artefact or k.startswith(f"{artefact}/")}


def verdict(old: Mapping[str, str], new: Mapping[str, str], now: Mapping[str, str]) -> str:
    if now == old:
        return "old kept"
    if now == new:
        return "new"
    return "lost" if set(now) < set(old) else "mixed"


def attack(name: str, inputs: Path, count: int, seed: int) -> Counter[str]:
    """Attack one command: kills, a full disk, a forbidden folder; return what happened."""
    from tests.kills_each import EachAttack

    with tempfile.TemporaryDirectory() as folder:
        one = (EachAttack if name == "each" else Attack)(name, inputs, Path(folder))
        rng = random.Random(f"{seed} {name}")
        found: Counter[str] = Counter()
        for _ in range(count):
            found += one.kill(rng)
        found += one.tidy()
        for more in (one.full_disk, one.forbidden):
            found += more()
        return found


BAD = ("lost", "mixed", "litter", "tracebacks")


def run() -> int:
    """Attack all commands and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=200, help="kills over all commands")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--command", nargs="+", choices=list(commands()), default=list(commands()))
    args = parser.parse_args()
    total: Counter[str] = Counter()
    names = ("kills", "ended", "old kept", "new", "resumed", "refused", *BAD)
    print(f"{'command':<12}" + "".join(f"{name:>11}" for name in names), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        inputs = prepared(Path(folder))
        for name in args.command:
            found = attack(name, inputs, -(-args.count // len(args.command)), args.seed)
            total += found
            print(f"{name:<12}" + "".join(f"{found[key]:>11}" for key in names), flush=True)
    print(f"{'all':<12}" + "".join(f"{total[key]:>11}" for key in names))
    return int(any(total[key] for key in BAD))


if __name__ == "__main__":
    sys.exit(run())
