"""Machines and logs that are not pinotwin's own: another simulator's, real ones, and faults put into them.

The scripts that make them lie beside the recordings (``../foreign`` next to ``$PINOTWIN_DATA``), are run in
a process of their own and are no part of the package. Where they are absent, whoever asks is told so.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from benchmarks.questions.real import data_folder
from pinotwin.errors import DataError

FOREIGN = ("foreign.py", "faults.py", "real.py")
"""Scripts that must be there."""


@dataclass(frozen=True)
class Elsewhere:
    """The scripts, the recordings, and a folder of our own for what they write.

    Attributes:
        scripts: folder of ``foreign.py``, ``faults.py`` and ``real.py``.
        data: folder of the recordings.
        work: cases are written here, each once.
    """

    scripts: Path
    data: Path
    work: Path

    @classmethod
    def at_hand(cls, work: Path, data: str | None = None) -> Elsewhere | None:
        """Return the scripts beside the recordings; None where either is absent.

        Args:
            work: folder to write to.
            data: folder of the recordings; ``$PINOTWIN_DATA`` unless given.
        """
        folder = data_folder(data)
        if folder is None:
            return None
        scripts = Path(os.environ.get("PINOTWIN_FOREIGN", folder.parent / "foreign"))
        whole = all((scripts / name).is_file() for name in FOREIGN)
        return cls(scripts.resolve(), folder.resolve(), work.resolve()) if whole else None

    def case(self, machine: str, kind: str, seed: int) -> Path:
        """Return the folder of a case of the other simulator: machine, healthy, train, repeat, valid, answer."""
        folder = self.work / f"{machine.replace(':', '')}-{kind}-{seed}"
        if not (folder / "answer.json").is_file():
            part = folder.with_name(f"{folder.name}.part{os.getpid()}")  # another process may want it too
            self._run("foreign.py", "case", part, kind, seed, "--machine", machine)
            try:
                part.rename(folder)
            except OSError:  # it is there by now
                shutil.rmtree(part)
        return folder

    def answer(self, case: Path) -> dict[str, str]:
        """Return the sealed answer of a case: kind, axis, situation."""
        answer: dict[str, str] = json.loads((case / "answer.json").read_text(encoding="utf-8"))
        return answer

    def real(self, name: str) -> tuple[Path, list[Path], Path]:
        """Return the machine of a set of recordings, the logs of its twin, and a log of another time."""
        code = (
            f"import sys, json; sys.path.insert(0, {str(self.scripts)!r}); import real; from pathlib import Path; "
            f"s = real.sets(Path({str(self.data)!r}), Path({str(self.work)!r})); "
            "print(json.dumps({k: [str(v[0]), [str(x) for x in v[1]], str(v[2])] for k, v in s.items()}))"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], check=False, capture_output=True, text=True, env=_alone()
        )
        if done.returncode:
            raise DataError(f"{self.scripts / 'real.py'}: {_last(done.stderr)}")
        machine, own, test = json.loads(done.stdout)[name]
        return Path(machine), [Path(x) for x in own], Path(test)

    def faulty(self, name: str, kind: str, axis: str, size: float, seed: int) -> Path:
        """Return the other log of a set with a fault put into one axis.

        Args:
            name: of the set.
            kind: of the fault.
            axis: where.
            size: RMS of what it adds over that of the effort's variation; kg of a payload, s of a delay.
            seed: of what the fault leaves to chance.
        """
        machine, _, test = self.real(name)
        log = self.work / f"{name}-{kind}-{axis}-{size:g}-{seed}.csv"
        if not log.is_file():
            part = log.with_suffix(f".part{os.getpid()}")
            self._run("faults.py", machine, test, part, kind, axis, "--size", size, "--seed", seed)
            part.replace(log)
        return log

    def _run(self, script: str, *args: object) -> None:
        self.work.mkdir(parents=True, exist_ok=True)
        done = subprocess.run(
            [sys.executable, str(self.scripts / script), *map(str, args)],
            check=False,
            capture_output=True,
            text=True,
            env=_alone(),
        )
        if done.returncode:
            raise DataError(f"{self.scripts / script}: {_last(done.stderr)}")


def _alone() -> dict[str, str]:
    """Return the environment with one thread: many processes run beside each other."""
    return {**os.environ, "OPENBLAS_NUM_THREADS": "1"}


def _last(text: str) -> str:
    return (text.strip().splitlines() or ["no message"])[-1]
