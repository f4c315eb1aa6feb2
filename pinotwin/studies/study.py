"""What every study answers: a finding, its table, and the courses that its figure draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pinotwin.arrays import Floats


@dataclass(frozen=True, eq=False)
class Study:
    """One study of a machine and its logs.

    Attributes:
        finding: what it says, in a sentence.
        header: title of each column of the table.
        rows: of the table.
        courses: name -> values that the figure draws [SI].
        axis: whose effort the courses are, where they are one axis'.
        rotary: rad and N·m, else m and N.
        effects: what it is about: keys or names of effects.
        against: what those are a function of: ``velocity`` or ``position``.
    """

    finding: str
    header: Sequence[str]
    rows: Sequence[Sequence[object]]
    courses: Mapping[str, Floats] = field(default_factory=dict)
    axis: str = ""
    rotary: bool = False
    effects: tuple[str, ...] = ()
    against: str = ""

    def __getitem__(self, name: str) -> Floats:
        return self.courses[name]
