"""Record of a script's orders with their times, callers and outcomes, to be compared with the motors."""

import time
from dataclasses import dataclass, field

FOREVER = float("inf")


@dataclass
class Start:
    """An order that may run a motor. local: from the server's own machine, which may choose a policy.

    present_until: time until which its commander is present; infinite if none is needed.
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
    """An order that ends earlier starts. drive: empty for all drives. stands_until: end of a demand held by a PLC."""

    at: float
    door: str
    drive: str
    answered: float = FOREVER
    outcome: str = ""
    stands_until: float = 0.0
    how: str = "ramp"


@dataclass
class Trouble:
    """A disturbance of a line or a drive by a script. dead: nothing reaches the drive during it."""

    at: float
    until: float
    kind: str
    line: str = ""
    drive: str = ""
    dead: bool = False


@dataclass
class Removal:
    """A drive that was removed from the plant file, or changed in it. back: time of its return."""

    at: float
    drive: str
    back: float = FOREVER


@dataclass
class Book:
    """Record of a whole script. deaths: end of the server, its kind, and the time of the next server."""

    starts: list = field(default_factory=list)
    stops: list = field(default_factory=list)
    troubles: list = field(default_factory=list)
    deaths: list = field(default_factory=list)
    removals: list = field(default_factory=list)
    broker_lost: list = field(default_factory=list)
    said: list = field(default_factory=list)


def note_answer(order, answer):
    """Record the outcome of an order; None if no answer came."""
    if isinstance(answer, dict) and "outcome" in answer:
        order.answered, order.outcome = time.monotonic(), answer["outcome"]
    elif isinstance(answer, dict):
        order.answered, order.outcome = time.monotonic(), "refused"
