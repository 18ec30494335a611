"""What was asked of a plant in a script, by whom and when, and what they were answered: the other half of the truth."""

import time
from dataclasses import dataclass, field

FOREVER = float("inf")


@dataclass
class Start:
    """An order that may let a motor run. local: from the server's own machine, where a policy may be chosen.

    present_until: until when its commander is there; for ever where nobody has to be.
    """

    at: float
    door: str
    drive: str
    local: bool = False
    present_until: float = FOREVER
    answered: float = FOREVER
    outcome: str = ""


@dataclass
class Stop:
    """An order that ends what was started before it. drive: empty for all. stands_until: of one that is a level."""

    at: float
    door: str
    drive: str
    answered: float = FOREVER
    outcome: str = ""
    stands_until: float = 0.0
    how: str = "ramp"


@dataclass
class Trouble:
    """What a script did to a line or a drive. dead: nothing reaches the drive meanwhile."""

    at: float
    until: float
    kind: str
    line: str = ""
    drive: str = ""
    dead: bool = False


@dataclass
class Removal:
    """A drive that left the plant file, or was changed in it. back: when it was in it again."""

    at: float
    drive: str
    back: float = FOREVER


@dataclass
class Book:
    """All of a script. deaths: when the server was gone, how, and when there was one again."""

    starts: list = field(default_factory=list)
    stops: list = field(default_factory=list)
    troubles: list = field(default_factory=list)
    deaths: list = field(default_factory=list)
    removals: list = field(default_factory=list)
    broker_lost: list = field(default_factory=list)
    said: list = field(default_factory=list)


def note_answer(order, answer):
    """Note what came of an order; nothing where nobody answered."""
    if isinstance(answer, dict) and "outcome" in answer:
        order.answered, order.outcome = time.monotonic(), answer["outcome"]
    elif isinstance(answer, dict):
        order.answered, order.outcome = time.monotonic(), "refused"
