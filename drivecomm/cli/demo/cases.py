"""What the tour does with a drive of each protocol."""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """What is read from a drive and how it is moved.

    model: whose names and units are used, None for bare values. parameters: what is read. frequency: the parameter that
    shows output frequency or speed, signed. reference, backwards: what is set for running, in percent or hertz;
    backwards is for drives that reverse by a negative reference. fault: the code that a virtual drive trips with.
    """

    model: str | None = None
    parameters: tuple[str, ...]
    frequency: str = ""
    reference: dict[str, Decimal] = field(default_factory=lambda: {"percent": Decimal(60)})
    backwards: dict[str, Decimal] = field(default_factory=lambda: {"percent": Decimal(-40)})
    fault: int = 1


CASES = {
    "vabus": Case(
        model="agile",
        parameters=("stator_frequency", "rms_current", "481", "520[2]"),
        frequency="210",
        reference={"hz": Decimal(30)},
        backwards={"hz": Decimal(-20)},
        fault=3,
    ),
    "danfoss-fc": Case(model="fc300", parameters=("16-13", "16-14", "16-30", "3-41"), frequency="16-17", fault=14),
    "vlt3500": Case(model="vlt3500", parameters=("502[1]", "502[9]", "215", "516"), frequency="502[1]", fault=11),
    "fuji": Case(
        model="frenic",
        parameters=("M09", "M11", "M21", "F07"),
        frequency="M09",
        reference={"hz": Decimal(30)},
        backwards={"hz": Decimal(20)},
        fault=1,
    ),
}


def case_for(protocol: str, examples: tuple[str, ...]) -> Case:
    """Return what to do with a drive; a protocol of somebody else's is read by the examples that it names."""
    return CASES.get(protocol, Case(parameters=examples))
