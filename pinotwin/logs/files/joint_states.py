"""Joint states as tables: the names of the joints stand in cells beside their numbers.

rostopic echo -p           field.name0, field.name1 ..., field.position0, field.velocity0, field.effort0 ...
ros2 topic echo --csv      no header: stamp, frame, names, positions, velocities, efforts, one after the other
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pinotwin.arrays import Floats
from pinotwin.log import JOINT_SIGNALS

_NUMBERED = re.compile(r"(.*?)(name|position|velocity|effort)(?:\[|_)?(\d+)\]?$")


def joint_columns(
    columns: Sequence[str], texts: Mapping[str, str], arrays: Mapping[str, NDArray[np.generic]]
) -> dict[str, str]:
    """Return column -> ``<joint>.q .v .u`` by the names in ``texts``: columns that hold one text throughout -> it."""
    return _by_header(texts, arrays) or _by_order(columns, texts, arrays)


def stamps(columns: Sequence[str], arrays: Mapping[str, NDArray[np.generic]]) -> Floats | None:
    """Return the clock [s] of a table without a header that begins with seconds and nanoseconds, each of shape (n,)."""
    if len(columns) < 2 or not set(columns[:2]) <= set(arrays):
        return None
    seconds, rest = (np.asarray(arrays[c], dtype=float) for c in columns[:2])
    t = seconds - seconds[:1] + 1e-9 * rest
    whole = (
        np.all(seconds == np.round(seconds)) and np.all((rest >= 0) & (rest < 1e9)) and np.any(rest >= 1e3)
    )
    return t if whole and np.all(np.diff(t) >= 0) else None


def _by_header(texts: Mapping[str, str], arrays: Mapping[str, NDArray[np.generic]]) -> dict[str, str]:
    names = {
        (m[1], m[3]): joint for c, joint in texts.items() if (m := _NUMBERED.match(c)) and m[2] == "name"
    }
    found = ((c, _NUMBERED.match(c)) for c in arrays)
    return {
        c: f"{names[m[1], m[3]]}.{JOINT_SIGNALS[m[2]]}"
        for c, m in found
        if m and m[2] in JOINT_SIGNALS and (m[1], m[3]) in names
    }


def _by_order(
    columns: Sequence[str], texts: Mapping[str, str], arrays: Mapping[str, NDArray[np.generic]]
) -> dict[str, str]:
    """Name the numbers behind the last run of names: positions first, then speeds and efforts as far as there are."""
    ends = [i for i, c in enumerate(columns) if c in texts]
    behind = [c for c in columns[ends[-1] + 1 :] if c in arrays] if ends else []
    if not behind or len(ends) < 2 or len(behind) != len(columns) - ends[-1] - 1:
        return {}
    run = [c for i, c in enumerate(columns[: ends[-1] + 1]) if c in texts and ends[-1] - i < len(ends)]
    for names in (run, run[1:]):  # a frame may stand before the names
        groups, rest = divmod(len(behind), max(len(names), 1))
        if names and not rest and 1 <= groups <= 3 and len(set(texts[c] for c in names)) == len(names):
            signals = {1: "q", 3: "qvu"}.get(groups) or ["q", _second(behind, len(names), arrays)]
            joints = [texts[c] for c in names] * groups
            return {
                c: f"{joint}.{signals[k // len(names)]}"
                for k, (c, joint) in enumerate(zip(behind, joints, strict=True))
            }
    return {}


def _second(behind: Sequence[str], joints: int, arrays: Mapping[str, NDArray[np.generic]]) -> str:
    """Return whether the second group is speeds (it goes with the change of the first) or efforts."""
    pairs = zip(behind[:joints], behind[joints:], strict=True)
    alike = [
        np.corrcoef(np.gradient(np.asarray(arrays[q], dtype=float)), np.asarray(arrays[x], dtype=float))[0, 1]
        for q, x in pairs
        if np.ptp(arrays[q]) > 0 and np.ptp(arrays[x]) > 0
    ]
    return "v" if alike and float(np.median(alike)) > 0.9 else "u"
