"""The families of effects: what an effect acts on is said here once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Acts = Literal["effort", "states", "sensor", "loop"]


@dataclass(frozen=True)
class Family:
    """What the effects of one file have in common."""

    name: str  # of the family
    title: str  # what it is called in a report
    # ``effort`` adds to the effort of the joints; ``states`` does so too, but moves a mass that no encoder of
    # the log sees (a motor against its load); ``sensor`` changes what is logged, not what the machine does;
    # ``loop`` belongs to the controller: it changes the tracking error and leaves the plant as it is
    acts: Acts


FRICTION = Family("friction", "Friction", "effort")
POSITION = Family("position", "Effort of position", "effort")
BODY = Family("body", "Bodies and their coupling", "effort")
TRANSMISSION = Family("transmission", "Drive train", "states")
SENSING = Family("sensing", "Sensors", "sensor")
LOAD = Family("load", "Load", "effort")
SERVO = Family("servo", "Controller", "loop")
OTHER = Family("other", "Other", "effort")

FAMILIES = (BODY, FRICTION, POSITION, TRANSMISSION, SENSING, LOAD, SERVO)
