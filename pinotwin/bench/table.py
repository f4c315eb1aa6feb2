"""The table of scores as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def lines(scores: Mapping[str, Any]) -> list[str]:
    """Return the table of scores, line by line."""
    single, healthy = scores["single"], scores["healthy"]
    out = [f"healthy, named anything          {_share(healthy['false_alarms'])}"]
    out.append(f"top-1, gap above 0.1 of noise    {_share(single['top1_rho_above_0.1'])}")
    for bin_, value in single["top1_by_rho"].items():
        out.append(f"  rho {bin_:<27}{_share(value)}")
    out.append(f"truth in the stated set          {_share(single['truth_in_set'])}")
    out.append(f"mean size of the set             {single['mean_set']:.2f}")
    out.append(f"spurious extra beside right one  {_share(single['spurious_extra'])}")
    out.append(f"both of two                      {_share(scores['double']['both'])}")
    out.append(f"outside the catalogue recognised {_share(scores['outside']['recognised'])}")
    out.append(f"known called unknown             {_share(single['called_unknown'])}")
    if scores["calibration_error"]:
        out.append(f"calibration error                {scores['calibration_error']['ece']:.3f}")
    for name, floor in scores["floors"].items():
        out.append(
            f"{name:<14} alarms {_share(floor['false_alarms'])}, "
            f"top-1 {_share(floor['top1_rho_above_0.1'])}"
        )
    out += ["", "true effect -> answers"]
    for true, answers in scores["confusion"].items():
        said = ", ".join(f"{k} {v}" for k, v in sorted(answers.items(), key=lambda x: -x[1]))
        out.append(f"  {true:<20}{said}")
    return out


def _share(value: Mapping[str, float] | None) -> str:
    return "-" if value is None else f"{value['share']:.0%} of {value['of']}"
