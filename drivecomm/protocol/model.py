"""Drive models: facts about the parameters of one drive series, as data with sources.

`drivecomm.models.files` reads the files of models; docs/reference/models.md explains them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from drivecomm.errors import ValueRefusedError, counted

if TYPE_CHECKING:
    from collections.abc import Mapping

Access: TypeAlias = Literal["r", "w", "rw", "rw*"]
"""r: read only. w: write only. rw: both. rw*: writing is refused while the motor runs."""

Sureness: TypeAlias = Literal["printed", "derived", "field", "unconfirmed", "imported", "drive", "contradicted"]
"""How certain a fact is.

printed: a document prints it. derived: it follows from a document. field: seen on a drive. unconfirmed: claimed
somewhere. imported: taken from a file of another program, so that it counts as unconfirmed, and a drive of a model
without commands accepts no write at all. drive: a proof has checked it on a drive and confirmed it. contradicted: a
proof has shown something else, so that it counts as unconfirmed.
"""

_NOTES: Mapping[Sureness, str] = {
    "derived": "type and unit are derived",
    "field": "type and unit are as seen on a drive",
    "unconfirmed": "type and unit are unconfirmed",
    "imported": "type and unit are imported from a file of another program",
    "contradicted": "type and unit are contradicted by a drive",
}

CERTAIN: frozenset[Sureness] = frozenset({"printed", "drive"})
"""Marks of facts that need no remark."""

DOUBTFUL: frozenset[Sureness] = frozenset({"unconfirmed", "imported", "contradicted"})
"""Marks of facts on which no command and no common name of a packaged model may depend."""

Storage: TypeAlias = Literal["", "stored", "volatile"]
"""stored: kept in EEPROM if written with `store=True`. volatile: lost without power. Empty: unknown."""

ParameterKind: TypeAlias = Literal["setting", "communication", "command"]
"""Purpose of a parameter.

setting: for the operation of the drive. communication: for its communication, so that a change can cut the line.
command: a write makes the drive do something (control word, bus reference, tuning, initialising), so that the parameter
does not belong in a backup.
"""

LinkLoss: TypeAlias = Literal["hold", "ramp", "coast", "trip"]
"""Reaction of a motor to a silent master: it runs on, stops down a ramp, coasts, or the drive trips."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterInfo:
    """Facts about one parameter.

    start: a plausible physical value for a virtual drive.
    """

    address: str
    name: str
    title: str
    type: str = ""
    unit: str = ""
    factor: Decimal = Decimal(1)
    access: Access = "rw"
    storage: Storage = ""
    kind: ParameterKind = "setting"
    values: Mapping[int, str] = field(default_factory=dict)
    minimum: Decimal | None = None
    maximum: Decimal | None = None
    start: Decimal | str | None = None
    source: str = ""
    printed: str = ""
    """The scale as the source prints it.

    `0.01 Hz` for a step, `x 100 A` if the raw value is 100 times the value in A.
    """
    second_source: str = ""
    sure: Sureness = "printed"
    proof: str = ""
    """Name of the proof that has confirmed or contradicted this fact; empty without a proof."""
    only_with: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Raw values that other parameters must have for this one to take effect, by the addresses of the others."""
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Keys of this parameter that only its protocol uses, such as `datasets` or `conversion_index`."""

    @property
    def note(self) -> str:
        """Remark on the certainty of type, scale and unit; empty if a document prints or a drive confirms them."""
        return _NOTES.get(self.sure, "")

    def allows(self, physical: Decimal | float) -> bool:
        """Return whether a value is within the known limits."""
        return (self.minimum is None or physical >= self.minimum) and (self.maximum is None or physical <= self.maximum)

    def check(self, physical: Decimal) -> None:
        """Raise ValueRefusedError for a value outside the limits."""
        if not self.allows(physical):
            if self.minimum is not None and self.maximum is not None:
                where = f"outside {self.minimum} to {self.maximum}"
            else:
                where = f"above {self.maximum}" if self.minimum is None else f"below {self.minimum}"
            raise ValueRefusedError(f"{physical} for parameter {self.address} is {where} {self.unit}".rstrip())


@dataclass(frozen=True, slots=True, kw_only=True)
class Watchdog:
    """Parameters by which drives of a model notice a silent master, and the reaction of the drives.

    time: address of the parameter with the time in seconds; 0 means never unless `off` says otherwise. action: address
    of the parameter that selects the reaction; empty if the reaction is always the same. actions: the raw value of this
    parameter for each policy; without such a parameter, the only policy, with any number. off: raw value of `time` that
    switches the watchdog off; None if the action for "hold" switches it off. fault: code of the fault with which the
    drive then trips; None if no source states it. note: further remarks.
    """

    time: str
    action: str = ""
    actions: Mapping[LinkLoss, int] = field(default_factory=dict)
    off: int | None = None
    fault: int | None = None
    source: str = ""
    second_source: str = ""
    sure: Sureness = "printed"
    note: str = ""


Purpose: TypeAlias = Literal["access", "line", "commands", "reference", "link loss"]
"""Purpose of a panel setting.

access: access to the other settings. line: communication. commands: obeying commands. reference: taking a reference.
link loss: noticing a silent master.
"""

MadeFrom: TypeAlias = Literal[
    "address", "baudrate", "bytesize", "parity", "stopbits", "format", "line", "link_loss", "watchdog_s"
]
"""The part of a plant from which the value of a panel setting is made.

format: character format, such as 8E1. line: baud rate and character format, such as 9600 8E1. link_loss, watchdog_s:
the policy of the drive, and its time in seconds.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelSetting:
    """One setting that a person makes at the drive, so that it communicates and obeys.

    parameter: as the panel shows it. value: the value to set, as the panel shows it; empty if it is made from the
    plant. also: other values that work as well. means: the meaning of the value. codes: the panel's value for each
    value of the plant; empty if the panel takes the plant's value itself. hexadecimal: whether the panel shows an
    address as a hexadecimal number. unit: unit of a time. factory: the factory value, empty if unknown. address:
    address of the parameter if it can be read over the line; empty otherwise. when: the drives or ports that the
    setting concerns, empty for all. note: further remarks.
    """

    parameter: str
    name: str
    purpose: Purpose
    value: str = ""
    also: tuple[str, ...] = ()
    means: str = ""
    made_from: MadeFrom | None = None
    codes: Mapping[str, str] = field(default_factory=dict)
    hexadecimal: bool = False
    unit: Literal["s", "ms"] = "s"
    factory: str = ""
    address: str = ""
    when: str = ""
    note: str = ""
    source: str = ""
    second_source: str = ""
    sure: Sureness = "printed"


WATCHDOG_PROOF = "watchdog"
"""Key in `Model.proofs` for the watchdog as a whole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proved:
    """Result of a proof for one fact.

    sure: `drive` or `contradicted`. before: the mark that the sources give the fact.
    """

    sure: Sureness
    proof: str
    before: Sureness = "printed"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Model:
    """Parameters and fault texts of one drive series, and the drive options that suit it.

    quantities: the address of the parameter behind each common name. watchdog: None if none is known. identified_by: a
    regular expression for each entry of `Drive.identify` that identifies the series, by the name of the entry; all must
    match. fault_log: addresses of the parameters in which the drive keeps its latest faults, the newest first.
    link_loss: the reaction of drives without a configurable watchdog to a silent master, as a sentence. control: the
    commands of the drives, if their protocol leaves them to the model; see `Protocol.control_keys`. sources: the
    documents and programs that confirm `commands` and `status`, two of each if there are two. setup: the settings that
    a person makes at the panel of the drive, in this order. proofs: results of proofs, by the address of a parameter or
    by WATCHDOG_PROOF; the facts carry these marks, too. extends: the name of the model on which this one is based,
    empty for none.
    """

    protocol: str
    name: str
    title: str
    source: str
    parameters: Mapping[str, ParameterInfo]
    faults: Mapping[int, str]
    options: Mapping[str, Any]
    warnings: Mapping[int, str] = field(default_factory=dict)
    quantities: Mapping[str, str] = field(default_factory=dict)
    watchdog: Watchdog | None = None
    fault_log: tuple[str, ...] = ()
    link_loss: str = ""
    identified_by: Mapping[str, str] = field(default_factory=dict)
    control: Mapping[str, Any] = field(default_factory=dict)
    sources: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    setup: tuple[PanelSetting, ...] = ()
    proofs: Mapping[str, Proved] = field(default_factory=dict)
    extends: str = field(default="", compare=False)

    def __hash__(self) -> int:
        # Equal models have the same protocol and name; their other content is large, and its tables have no hash.
        return hash((self.protocol, self.name))

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name} of {self.protocol}, {counted(len(self.parameters), 'parameter')}>"

    def find(self, name_or_address: str) -> ParameterInfo | None:
        """Return the parameter with this address or this name; None if the model does not have it."""
        if name_or_address in self.parameters:
            return self.parameters[name_or_address]
        return next((known for known in self.parameters.values() if known.name == name_or_address), None)

    def matches(self, identity: Mapping[str, str]) -> bool:
        """Return whether a drive with this identity is of this series; always False for a model without a rule.

        identity: the entries of `Drive.identify`.
        """
        import re

        return bool(self.identified_by) and all(
            re.fullmatch(pattern, identity.get(key, "")) for key, pattern in self.identified_by.items()
        )
