"""Write docs/effects.md from the effects themselves; ``make docs`` runs it, a test holds it true."""

from __future__ import annotations

from pathlib import Path

from pinotwin.effects import EFFECTS, Effect
from pinotwin.machine.effect_list import settings_of

HEAD = """# Effects

Every effect adds `columns(motion; shape) @ theta` to the effort of its axis. Coefficients (theta) are
solved by least squares, shapes are searched. `rigid_body` (inertia, coupling, Coriolis, centrifugal,
gravity: the base parameters of the whole tree) belongs to every machine. Units are for a linear axis; a
rotary one has rad for m and N·m for N. One of your own is a class of 20 lines in any module:
[your own effect](own_effect.md).

"""


WHERE = """## Where each can be used

*Listed*: under `effects` of an axis in machine.yaml. *Identified*: coefficients with intervals. *Simulated*:
`by passes` evaluates the effect on the response and runs again until it stays the same; play may be refused in one
line. A load on a spring has states of its own beside identified controllers (`coupled`); free loops have it among their
poles. *Looked for*: what a search
chooses beside the coefficients (`EFFECTS[name].candidates`). *Applied*: where a finding is written.

| effect | family | listed | identified | simulated | looked for | applied |
|---|---|---|---|---|---|---|
"""


def page() -> str:
    """Return the text of docs/effects.md."""
    sections = "\n".join(_section(name) for name in EFFECTS if name != "rigid_body")
    return HEAD + WHERE + "".join(_row(name) for name in EFFECTS) + "\n" + sections


def _row(name: str) -> str:
    """Return one line of the table that says where an effect can be used."""
    effect = EFFECTS[name]
    listed = "always" if name == "rigid_body" else "no" if effect.unlisted else "yes"
    in_loop = effect.family.acts == "loop"
    identified = "yes" if listed != "no" else "with the controller" if in_loop else "by diagnose"
    shapes = "shape" if effect.searched == 1 else "shapes"
    searched = f"{effect.searched} {shapes}" if effect.searched else "linear"
    applied = {"yes": "machine.yaml", "always": "URDF"}.get(listed, f"by hand: it {effect.unlisted}")
    if name == "saturation":
        applied = "machine.yaml, `effort_limit`"
    cells = (name, effect.family.title, listed, identified, _simulated(effect), searched, applied)
    return f"| {' | '.join(cells)} |\n"


def _simulated(effect: type[Effect]) -> str:
    """Return how a simulation takes an effect in."""
    if effect.family.acts == "loop":
        return "in the loop"
    if effect.unlisted and effect.name != "rigid_body":
        return "no"
    if effect.logged_effort:
        return "in the logged effort"
    if effect.family.acts == "states":
        return "by passes, or refused" if effect.mode is Effect.mode else "with states of its own"
    in_step = effect.depends != "other" or effect.causes[0] in ("viscous", "stiffness", "rigid_body")
    return "step by step" if in_step else "by passes"


def _section(name: str) -> str:
    effect = EFFECTS[name](axis="X", rotary=False)  # type: ignore[call-arg]
    text = (type(effect).__doc__ or "").split("\n\n    Attributes")[0]
    lines = [line.strip() for line in text.strip().splitlines()]
    coefficients = ", ".join(f"`{c.name}` [{c.unit}]" for c in effect.coefficients()) or "from the log"
    shapes = ", ".join(f"`{s.name}` [{s.unit}], {s.lower:.3g} to {s.upper:.3g}" for s in effect.shapes())
    settings = ", ".join(f"`{key}`" for key in settings_of(type(effect)))
    rows = [f"## {name}", "", _sentence(effect.words), "", *lines, ""]
    rows += [f"- coefficients: {coefficients}"]
    rows += [f"- shapes searched: {shapes}"] if shapes else []
    if effect.unlisted:
        rows += [f"- not listed: it {effect.unlisted}"]
    else:
        rows += [f"- settings in YAML: {settings}"] if settings else []
    for title, names in (
        ("contains", effect.contains),
        ("easily taken for", effect.imitates),
        ("one axis cannot tell it from", effect.inseparable),
    ):
        rows += [f"- {title}: {', '.join(names)}"] if names else []
    return "\n".join([*rows, f"- what to do: {effect.remedy}", ""])


def _sentence(words: str) -> str:
    return words[0].upper() + words[1:] + "."


if __name__ == "__main__":
    (Path(__file__).parent / "effects.md").write_text(page(), encoding="utf-8")
