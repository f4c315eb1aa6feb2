"""Spoil sound files of every format at random and read them: a result, or one line that says why not.

    python -m tests.fuzz [--count 10000] [--seconds 120] [--reader csv ...]

Every reader runs in a process of its own that reports file by file, so that a crash or a hang is counted,
not suffered. A case is good if it is read, or refused by an error of pinotwin in one line of under 500
letters; anything else is counted as traceback, hang (over 10 s, more than a reader's own limit for the isolated
ones), crash or memory (over 2 GB). ``altered`` counts what is read with other channels or values than were written and
no note that says so; of a file with checksums that is bad too. Bags of ROS 2 in MCAP are spoiled as a file without
checksums, in a folder and with them, and in the folder's metadata.yaml.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing as mp
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from pinotwin.errors import PinotwinError
from tests.rig import URDF, YAML, good_log

READERS = (
    "csv",
    "parquet",
    "mat",
    "mat73",
    "hdf5",
    "npy",
    "mcap",
    "json",
    "jsonl",
    "ros1",
    "ros2",
    "ros2_mcap",
    "ros2_folder",
    "ros2_metadata",
    "urdf",
    "yaml",
    "twin",
)
CHECKED = ("npy", "mcap", "ros2_folder")
"""Readers whose sound file carries checksums: what is read of a spoiled one is what was written."""
HANG = 45.0  # s; the readers in a child process may take 30 s
MEMORY = 2.0e9
ADDRESSES = (
    8 * 2**30
)  # bytes; more than MEMORY, so that what is only asked for is not counted, and the machine lives


def sound(reader: str, folder: Path) -> Path:
    """Write a sound file for a reader, and what it needs beside it; return the one to spoil."""
    folder.mkdir(parents=True, exist_ok=True)
    log = {k: x[:300] for k, x in good_log().items()}
    table = np.column_stack(list(log.values()))
    if reader == "csv":
        path = folder / "log.csv"
        np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(log), comments="")
    elif reader == "parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        path = folder / "log.parquet"
        pq.write_table(pa.table(log), path)
    elif reader == "mat":
        import scipy.io

        path = folder / "log.mat"
        scipy.io.savemat(path, {"t": log["t"], "rec": {k.replace(".", "_"): x for k, x in log.items()}})
    elif reader in ("mat73", "hdf5"):
        path = _hdf5(folder, log, matlab=reader == "mat73")
    elif reader == "npy":
        path = folder / "log.npz"
        np.savez(path, **log)  # type: ignore[arg-type]
    elif reader in ("json", "jsonl"):
        path = _json(folder / f"log.{reader}", log)
    elif reader.startswith("ros"):
        path = _ros(folder, log, reader)
    elif reader == "mcap":
        path = _mcap(folder / "log.mcap", log)
    else:
        path = _machine(reader, folder)
    return path


def _hdf5(folder: Path, log: dict[str, Any], *, matlab: bool) -> Path:
    import h5py

    path = folder / ("log.mat" if matlab else "log.h5")
    with h5py.File(path, "w", userblock_size=512 if matlab else 0) as file:
        group = file.create_group("servo")
        for k, x in log.items():
            item = group.create_dataset(k.replace(".", "_"), data=x, compression=None if matlab else "gzip")
            item.attrs["unit"] = "s" if k == "t" else "m"
    if matlab:
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def _mcap(path: Path, log: dict[str, Any]) -> Path:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("s", "jsonschema", b"{}")
        channel = writer.register_channel("servo", "json", schema)
        for k, t in enumerate(log["t"]):
            row = json.dumps({name: float(x[k]) for name, x in log.items()}).encode()
            writer.add_message(channel, int(t * 1e9), row, int(t * 1e9))
        writer.finish()
    return path


def _json(path: Path, log: dict[str, Any]) -> Path:
    columns = {k: x.tolist() for k, x in log.items()}
    rows = (json.dumps(dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True))
    path.write_text("\n".join(rows) if path.suffix == ".jsonl" else json.dumps(columns))
    return path


def _ros(folder: Path, log: dict[str, Any], reader: str) -> Path:
    from tests.ros_bags import write_bag

    if reader == "ros1":
        return write_bag(folder / "log.bag", log, storage="ros1")
    if reader == "ros2":
        return next(write_bag(folder / "bag", log, storage="sqlite3").glob("*.db3"))
    from tests.ros_bags import with_checksums

    bag = write_bag(folder / "bag", log, command=True)
    stored = bag / "bag.mcap"
    if reader == "ros2_folder":
        with_checksums(stored, "lz4")
    return bag / "metadata.yaml" if reader == "ros2_metadata" else stored


def _machine(reader: str, folder: Path) -> Path:
    (folder / "rig.urdf").write_text(URDF.replace("<robot", "<!-- Gerät -->\n<robot", 1), encoding="utf-8")
    (folder / "machine.yaml").write_text(YAML + "columns:\n  X.q: {column: x, unit: mm}\n", encoding="utf-8")
    if reader != "twin":
        return folder / ("rig.urdf" if reader == "urdf" else "machine.yaml")
    import pinotwin as pt

    log = pt.Log({k: x[:1500] for k, x in good_log().items()})
    pt.identify(pt.Machine.load(folder), log, loop=False).save(folder / "twin")
    return folder / "twin" / "twin.json"


def spoiled(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes with a few of them changed, cut, repeated, or replaced by what often breaks readers."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at, kind = int(rng.integers(0, max(1, len(out)))), int(rng.integers(0, 8))
        if kind == 0:
            out[at : at + 1] = bytes([int(rng.integers(0, 256))])
        elif kind == 1:
            out[at : at + 1] = bytes([out[at] ^ (1 << int(rng.integers(0, 8)))]) if out else b"x"
        elif kind == 2:
            del out[at : at + int(rng.integers(1, 64))]
        elif kind == 3:
            out[at:at] = out[at : at + int(rng.integers(1, 64))]
        elif kind == 4:
            del out[at:]
        elif kind == 5:
            out[at : at + 8] = rng.choice([b"\xff" * 8, b"\x00" * 8, b"\xff" * 7 + b"\x7f"])
        elif kind == 6:
            words = [
                b"nan",
                b"-1e309",
                b"9" * 400,
                b"\xe4",
                b"[[[[",
                b"&a [*a]",
                b'"',
                b"\n",
                b"1,234.5",
                b"{}",
            ]
            out[at:at] = words[int(rng.integers(0, len(words)))]
        else:
            other = int(rng.integers(0, max(1, len(out))))
            out[at : at + 16] = out[other : other + 16]
    return bytes(out)


def reader_of(name: str) -> Callable[[Path], object]:
    """Return what reads a path of a format."""
    import pinotwin as pt

    if name in ("urdf", "yaml"):
        return lambda path: pt.check(pt.Machine.load(path.parent))
    if name in ("ros2", "ros2_folder", "ros2_metadata"):
        return lambda path: pt.read(path.parent)
    if name == "twin":
        return lambda path: pt.Twin.load(path.parent)
    return pt.read


def _work(name: str, path: Path, seeds: range, pipe: Connection) -> None:
    """Read one spoiled file after the other; say the number before, and the outcome after, each."""
    sound_bytes, read = path.read_bytes(), reader_of(name)
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    written = read(path)
    for seed in seeds:
        path.write_bytes(spoiled(sound_bytes, np.random.default_rng([seed, READERS.index(name)])))
        pipe.send((seed, "begun"))
        try:
            said = "accepted" if _same(read(path), written) else "altered"
        except PinotwinError as error:
            text = str(error)
            said = "refused" if "\n" not in text and len(text) < 500 else f"long: {text[:60]}"
        except Exception as error:  # noqa: BLE001 - what is looked for
            said = f"traceback: {type(error).__name__}: {str(error)[:60]}"
        if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0 > MEMORY:
            said = "memory"
        pipe.send((seed, said))
    pipe.send((-1, "done"))


def _same(read: object, written: object) -> bool:
    """Whether a log holds what was written, or says that something was left out; other results count as the same."""
    import pinotwin as pt

    if not (isinstance(read, pt.Log) and isinstance(written, pt.Log)):
        return True
    if set(read.notes) - set(written.notes):
        return True
    channels = {**read.channels, **read.scalars}, {**written.channels, **written.scalars}
    return list(channels[0]) == list(channels[1]) and all(
        np.array_equal(x, channels[1][k], equal_nan=True) for k, x in channels[0].items()
    )


def fuzz(name: str, count: int, folder: Path, *, start: int = 0, seconds: float = 1e9) -> Counter[str]:
    """Return how often each outcome was seen; ``tried`` is how many files were read."""
    path = sound(name, folder / name)
    good = path.read_bytes()
    tally: Counter[str] = Counter()
    seed, end = start, time.monotonic() + seconds
    while seed < start + count and time.monotonic() < end:
        path.write_bytes(good)
        seed = _run(name, path, range(seed, start + count), tally, end)
    return tally


def _run(name: str, path: Path, seeds: range, tally: Counter[str], end: float) -> int:
    """Run one worker until it is done, dies, hangs, or has used too much; return the next seed."""
    here, there = mp.get_context("fork").Pipe(duplex=False)
    job = mp.get_context("fork").Process(target=_work, args=(name, path, seeds, there))
    job.start()
    there.close()
    at = seeds.start
    try:
        while time.monotonic() < end:
            if not here.poll(HANG):
                _count(tally, "hang", at, name)
                return at + 1
            at, said = here.recv()
            if at < 0:
                return seeds.stop
            if said != "begun":
                _count(tally, said, at, name)
                if said == "memory":
                    return at + 1
        return seeds.stop
    except EOFError:
        _count(tally, "crash", at, name)
        return at + 1
    finally:
        if job.is_alive():
            job.kill()
        job.join()


def _count(tally: Counter[str], said: str, seed: int, name: str) -> None:
    tally["tried"] += 1
    tally[said.partition(":")[0]] += 1
    if said not in ("accepted", "refused") and (said != "altered" or name in CHECKED):
        sys.stderr.write(f"{name} seed {seed}: {said}\n")


def main() -> int:
    """Fuzz all readers and print a table; 1 if any case was bad."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=1e9, help="for each reader")
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--reader", nargs="+", default=list(READERS), choices=READERS)
    args = parser.parse_args()
    columns = ("tried", "refused", "accepted", "altered", "traceback", "long", "hang", "memory", "crash")
    sys.stdout.write("| reader | " + " | ".join(columns) + " |\n|---" + "|---" * len(columns) + "|\n")
    bad = 0
    folder = Path(tempfile.mkdtemp(prefix="pinotwin_fuzz_"))
    for name in args.reader:
        tally = fuzz(name, args.count, folder, start=args.start, seconds=args.seconds)
        bad += sum(tally[c] for c in columns[3 if name in CHECKED else 4 :])
        sys.stdout.write(f"| {name} | " + " | ".join(str(tally[c]) for c in columns) + " |\n")
        sys.stdout.flush()
    shutil.rmtree(folder, ignore_errors=True)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
