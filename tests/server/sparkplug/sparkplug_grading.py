"""A grader that only listens: what can be seen of the specification's assertions for edge nodes and their devices.

Each check names the assertions that it covers by their ids, and says in our words what it looks for. It yields what it
has looked at: an empty text for what is right, or what is wrong. What no scenario has shown is not passed.
"""

from collections import defaultdict
from dataclasses import dataclass, field

from sparkplug_plant import GROUP, NODE

NAMESPACE = "spBv1.0"
DATA, BIRTHS = ("NDATA", "DDATA"), ("NBIRTH", "DBIRTH")
COUNTED = (*BIRTHS, *DATA, "DDEATH")
REBIRTH = "Node Control/Rebirth"
DATA_TYPES = range(1, 35)

CHECKS = {}


def check(*ids):
    """Let a function be what checks these assertions; each is checked once."""

    def add(function):
        for each in ids:
            assert f"tck-id-{each}" not in CHECKS, each
            CHECKS[f"tck-id-{each}"] = function
        return function

    return add


@dataclass
class Report:
    """What was found: how often each assertion was seen to hold, and what is wrong."""

    held: dict = field(default_factory=lambda: defaultdict(int))
    wrong: list = field(default_factory=list)

    @property
    def passed(self):
        broken = {name for name, _ in self.wrong}
        return {name for name in self.held if name not in broken}

    def add(self, other):
        for name, number in other.held.items():
            self.held[name] += number
        self.wrong += other.wrong


def graded(seen):
    """Return the report on what was seen; seen: messages, and the packets that were sent to the broker."""
    report = Report()
    for name, function in CHECKS.items():
        for problem in function(seen):
            if problem:
                report.wrong.append((name, problem))
            else:
                report.held[name] += 1
    return report


@dataclass
class Seen:
    """What a listener and a wire have seen of one edge node. host: whether it waits for one."""

    heard: list
    packets: list
    host: bool = False

    def of(self, *kinds):
        return [each for each in self.heard if each.kind in kinds and each.parts[1] == GROUP and each.parts[3] == NODE]

    def packet(self, kind):
        return [each for each in self.packets if each.kind == kind]

    def sessions(self):
        """Return the messages from each NBIRTH to what ends it."""
        found = []
        for each in self.of(*COUNTED):
            if each.kind == "NBIRTH" or not found:
                found.append([])
            found[-1].append(each)
        return found


def say(right, wrong):
    return "" if right else wrong
