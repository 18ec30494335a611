"""Drive models: what the parameters of one drive series mean, as data with a source.

`drivecomm.models.files` reads them; docs/reference/models.md explains the files.
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
"""printed: it stands in a document. derived: follows from one. field: seen on a drive. unconfirmed: said somewhere.
imported: taken over from a file of another program, so that it counts as unconfirmed, and a drive of a model without
orders takes no write at all. drive: a proof holds the drive against it, and shows it. contradicted: a proof shows
something else, so that it counts as unconfirmed."""

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
"""Marks of facts on which no command and no common name of a packaged model rests."""

Storage: TypeAlias = Literal["", "stored", "volatile"]
"""stored: kept in EEPROM when it is written so. volatile: gone without power. Empty: not known."""

ParameterKind: TypeAlias = Literal["setting", "communication", "command"]
"""setting: how the drive works. communication: how it is spoken to, so that a change can cut the line. command: to
write it is to do something (control word, bus reference, tuning, initialising), so that it belongs in no backup."""

LinkLoss: TypeAlias = Literal["hold", "ramp", "coast", "trip"]
"""What a motor does when its master falls silent: goes on, stops down a ramp, runs out, or a fault stops it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterInfo:
    """What is known about one parameter. `start` is a plausible value for a virtual drive, physical."""

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
    """The scale as the source prints it: `0.01 Hz` for a step, `x 100 A` where the raw value is so many times that."""
    second_source: str = ""
    sure: Sureness = "printed"
    proof: str = ""
    """The proof that has shown or contradicted this fact; empty without one."""
    only_with: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Other parameters, by address, and the raw values with one of which they let this one count; else it is without
    effect."""
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Keys of this parameter that only its protocol knows, such as `datasets` or `conversion_index`."""

    @property
    def note(self) -> str:
        """How sure type, scale and unit are; empty for a fact that a document prints or a drive has shown."""
        return _NOTES.get(self.sure, "")

    def allows(self, physical: Decimal | float) -> bool:
        """Whether a value is within the limits, as far as they are known."""
        return (self.minimum is None or physical >= self.minimum) and (self.maximum is None or physical <= self.maximum)

    def check(self, physical: Decimal) -> None:
        """Raise ValueRefusedError for a value that is not within the limits."""
        if not self.allows(physical):
            if self.minimum is not None and self.maximum is not None:
                where = f"outside {self.minimum} to {self.maximum}"
            else:
                where = f"above {self.maximum}" if self.minimum is None else f"below {self.minimum}"
            raise ValueRefusedError(f"{physical} for parameter {self.address} is {where} {self.unit}".rstrip())


@dataclass(frozen=True, slots=True, kw_only=True)
class Watchdog:
    """How drives of a model notice that their master has fallen silent, and what they do then.

    time: address of the parameter with the time in seconds, 0 for never unless `off` says otherwise. action: address of
    the parameter that says what happens; empty where it is always the same. actions: the raw value of it for each
    policy; without such a parameter the one policy there is, with any number. off: raw value of `time` that switches
    the watchdog off, None where it is switched off by the action for "hold". fault: the code of the fault that a drive
    trips with then, None where no source gives it. note: what is to be known besides.
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
"""What a panel setting is for: access to the others, talking, obeying, taking a reference, noticing a silent master."""

MadeFrom: TypeAlias = Literal[
    "address", "baudrate", "bytesize", "parity", "stopbits", "format", "line", "link_loss", "watchdog_s"
]
"""What of a plant the value of a panel setting is made from. format: characters, such as 8E1. line: rate and
characters, such as 9600 8E1. link_loss, watchdog_s: the policy of the drive, and its time in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelSetting:
    """One setting that a person makes at the drive, so that it talks and obeys.

    parameter: as the panel shows it. value: what to set, as the panel shows it, and also: what does as well; empty
    where the value is made from the plant. means: what that value stands for. codes: the panel's value for each value
    of the plant; empty where the panel takes that value itself. hexadecimal: whether the panel shows an address so.
    unit: of a time. factory: as delivered, empty if unknown. address: of the parameter where it can be read over the
    line; empty where it cannot. when: which drives or ports this is about, empty for all. note: what to know besides.
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
"""The key among `Model.proofs` for what is known of the watchdog as a whole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proved:
    """What a proof has made of one fact. sure: `drive` or `contradicted`. before: the mark that its sources give it."""

    sure: Sureness
    proof: str
    before: Sureness = "printed"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Model:
    """The parameters and fault texts of one drive series, and the drive options that suit it.

    quantities: which parameter each common name is, by its address. watchdog: None where none is known. identified_by:
    a regular expression for what the drive tells of itself, by the names that `Drive.identify` gives; all must match.
    fault_log: addresses of the parameters in which such a drive remembers its latest faults, the newest first.
    link_loss: what is known, without a watchdog that can be set, of drives whose master falls silent; as a sentence.
    control: how such drives are commanded, where their protocol leaves that to the model; `Protocol.control_keys`.
    sources: the documents and programs, two of each where there are two, that say so of `commands` and of `status`.
    setup: the settings that a person makes at the panel of such a drive, in the order in which they are made.
    proofs: what proofs have shown, by the address of a parameter, or WATCHDOG_PROOF; the facts carry these marks, too.
    extends: the name of the model that this one was read on top of, empty for none.
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
        # Equal models are of one series; all that they hold is too much to look at, and tables in it have no hash.
        return hash((self.protocol, self.name))

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name} of {self.protocol}, {counted(len(self.parameters), 'parameter')}>"

    def find(self, name_or_address: str) -> ParameterInfo | None:
        """Return the parameter with this address or this name, None when the model does not know it."""
        if name_or_address in self.parameters:
            return self.parameters[name_or_address]
        return next((known for known in self.parameters.values() if known.name == name_or_address), None)

    def matches(self, identity: Mapping[str, str]) -> bool:
        """Whether a drive that tells this of itself is of this series; never, where the model has no rule."""
        import re

        return bool(self.identified_by) and all(
            re.fullmatch(pattern, identity.get(key, "")) for key, pattern in self.identified_by.items()
        )
