"""What every study answers: a finding, its table, and the courses that its figure draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pinotwin.arrays import Floats


@dataclass(frozen=True, eq=False)
class Study:
    """One study of a machine and its logs."""

    finding: str  # what it says, in a sentence
    header: Sequence[str]  # title of each column of the table
    rows: Sequence[Sequence[object]]  # of the table
    courses: Mapping[str, Floats] = field(default_factory=dict)  # name -> values that the figure draws [SI]
    axis: str = ""  # whose effort the courses are, where they are one axis'
    rotary: bool = False  # rad and N·m, else m and N
    effects: tuple[str, ...] = ()  # what it is about: keys or names of effects
    against: str = ""  # what those are a function of: ``velocity`` or ``position``

    def __getitem__(self, name: str) -> Floats:
        return self.courses[name]
