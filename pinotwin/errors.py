"""Every error that pinotwin raises on purpose: one line that names the file, the key, and the remedy.

The command line prints that line and exits with 2; any other exception is a bug and keeps its traceback.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Sequence

LONGEST = 480  # letters of a message: names and values that it repeats may come from a file of any kind


class PinotwinError(Exception):
    """Root of all errors raised on purpose; its message is one line of bounded length."""

    def __init__(self, message: str = "") -> None:
        text = " ".join(str(message).split())
        if len(text) > LONGEST:
            text = f"{text[: LONGEST - 185]} ... {text[-180:]}"
        super().__init__(text)


class InputError(PinotwinError):
    """Something that the user gave cannot be used; the message says what and how to correct it."""


class OutputError(InputError):
    """A result cannot be written where it was asked for (full disk, no permission, in use)."""


class MachineError(InputError):
    """The URDF or the machine.yaml cannot be used."""


class LogError(InputError):
    """A log file, or a channel of it, cannot be used."""


class DataError(InputError):
    """The log is readable but does not hold what the task needs (too short, nothing moves...)."""


class TwinError(InputError):
    """A saved twin cannot be used (missing file, other schema, other machine)."""


MOST_WORDS = 30  # a hint lists all known words up to this many, else the nearest few


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint that names the known word nearest to ``name``, one that contains it first, and some others."""
    words = sorted(str(word) for word in known)
    folded = {word.casefold(): word for word in reversed(words)}
    given = str(name).casefold()
    close = difflib.get_close_matches(given, folded, n=6, cutoff=0.5)
    holding = sorted(
        (w for w in folded if given and given in w), key=lambda w: (not w.startswith(given), len(w))
    )
    near = [folded[word] for word in dict.fromkeys([*holding, *close])]
    hint = f"did you mean {near[0]!r}? " if near else ""
    if len(words) > MOST_WORDS:
        few = near[: max(6, len(holding))] or words[:6]
        return f"{hint}{'nearest' if near else 'some'} of {len(words)}: {', '.join(few)}"
    return f"{hint}known: {', '.join(words) if words else 'none'}"


def some(names: Sequence[str], most: int = 8) -> str:
    """Return the first ``most`` names, how many more there are, or that there is none."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more if names else "none"


def require(name: str, known: Collection[str], said: str, error: type[PinotwinError]) -> None:
    """Refuse a name that is not known, with what is said before it and a hint behind it."""
    if name not in known:
        raise error(f"{said} {name!r}; {nearest(name, known)}")
