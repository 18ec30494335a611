"""A grader that only listens, and checks the specification's observable assertions for edge nodes and devices.

Each check names the assertions that it covers by their ids, and describes its subject in our own words. For each thing
checked it yields an empty text, or a text that describes the error. An assertion that no scenario exercises does not
pass.
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
    """Register a function as the check of these assertions; each assertion has one check."""

    def add(function):
        for each in ids:
            assert f"tck-id-{each}" not in CHECKS, each
            CHECKS[f"tck-id-{each}"] = function
        return function

    return add


@dataclass
class Report:
    """Result of the checks: the number of times each assertion held, and the errors found."""

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
    """Return the report on observed traffic. seen: messages, and the packets sent to the broker."""
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
    """Traffic of one edge node, as a listener and a wire observed it.

    host: whether the edge node waits for a primary host.
    """

    heard: list
    packets: list
    host: bool = False

    def of(self, *kinds):
        return [each for each in self.heard if each.kind in kinds and each.parts[1] == GROUP and each.parts[3] == NODE]

    def packet(self, kind):
        return [each for each in self.packets if each.kind == kind]

    def sessions(self):
        """Return the messages of each session, from an NBIRTH to the message that ends it."""
        found = []
        for each in self.of(*COUNTED):
            if each.kind == "NBIRTH" or not found:
                found.append([])
            found[-1].append(each)
        return found


def say(right, wrong):
    return "" if right else wrong
