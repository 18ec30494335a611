"""How registers stand in telegrams: the one small class that a protocol package writes for drives that hold them.

A register is whatever the protocol can read or write by itself: a parameter, an instruction code, a coil. Everything
else of such a drive is the same in every protocol, and is in this room: its verbs (`RegisterOperations`), what it is
asked telegram by telegram (`RegisterConversation`), and how it behaves (`VirtualRegisterDrive`).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from drivecomm.errors import UsageError
from drivecomm.profiles.control_table import CONTROL_PARAMETERS, ControlTable, control_entries
from drivecomm.profiles.register_machine import RegisterRefusal
from drivecomm.profiles.registers import Place, Target
from drivecomm.protocol import WORD_TYPES, Intent, Model, WordFormat, difference, kept, tables_beside

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from decimal import Decimal

    from drivecomm.profiles.register_conversation import RegisterConversation
    from drivecomm.protocol import Ask, Damaged, Exchange, Message, ParameterInfo


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """What a request does: it reads so many registers from a place on, or writes these words.

    only_ram: whether what it writes goes to RAM on a drive whose other writes go to EEPROM.
    """

    place: Place
    count: int = 1
    words: tuple[int, ...] | None = None
    only_ram: bool = False


class Dialect:
    """The registers of one drive, and the telegrams that read and write them.

    A master and a virtual drive have one each, so that a virtual drive may keep in its own what a request has left
    behind (a page, an index). address: of the drive. options: an object of the package's options. model: None where it
    is not known.

    title: the protocol in messages, "Modbus has no start of its own". common_model: the file of the model by which a
    drive without one is commanded, where all are commanded alike; empty where they are not. broadcast_address: the
    address that all drives obey, None where there is none. requests: the message classes that a drive listens to, where
    it decodes others, too; probe: the place that a scan reads. identity: what `identify` reads, addresses by name.
    reply_kinds_of and `repeats` decide which reply belongs to which request: repeats names the fields, beside the
    address, that replies have from their request, by the kind of the reply; "" stands for every kind. refusals: texts
    by code. codes: the code with which a virtual drive refuses, by `Why`; a drive with one for "not set up" takes no
    command while the model's `needs` do not hold. reason: the place that tells the code of the last refusal, where
    refusals have none of their own; `codes` then has those of damaged requests by the category of the error, too.
    damage: codes of a request that came damaged, which is sent again, three times in all. busy: codes of a drive that
    wants to be asked again a little later. stop_again: further codes after which a stop is told again. types: those
    that a parameter can have; without u16 the first is that of a parameter of which nothing is known. joins: whether
    one telegram reads and writes several words from a place on, which then hold 32 bits or a text. most: registers that
    one telegram reads for several parameters. bridged: registers nobody asked for that may lie between two that are
    read together. whole: kinds of place of which one telegram tells all, whatever is asked; by kind their numbers.
    feeds_all: a telegram to any drive feeds this one's watchdog. continues: some requests name no drive and go on from
    the one before (`continued`), which a drive forgets when another drive is addressed, or something else is heard.
    doubts_echoes: a read proves that a drive is there before the reply to a `mirrored` write, which the echo of an
    adapter could be, is believed. follows: the common names that a virtual drive's motor obeys. state_timeout_s: time
    that a drive has to obey. reply_delay_s: how soon a virtual drive answers. reference_range: the frequencies of 0 and
    100 % by the options; reference_option: how to give the latter. advice: what to check when it does not start.
    """

    title: ClassVar[str]
    common_model: ClassVar[str] = ""
    broadcast_address: ClassVar[int | None] = None
    requests: ClassVar[type[Any] | tuple[type[Any], ...]] = object
    probe: Place = Place("", 0)
    identity: Mapping[str, str] = {}
    repeats: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    refusals: Mapping[int, str] = {}
    codes: Mapping[str, int] = {}
    reason: Place | None = None
    damage: Collection[int] = ()
    busy: Collection[int] = ()
    stop_again: Collection[int] = ()
    joins = False
    types: ClassVar[Sequence[str]] = WORD_TYPES
    most = 1
    bridged = 0
    whole: Mapping[str, range] = {}
    feeds_all = False
    continues = False
    doubts_echoes = False
    follows: Collection[str] = ("maximum_frequency", "acceleration_time", "deceleration_time")
    state_timeout_s = 3.0
    reply_delay_s = 0.005
    reference_range: tuple[Decimal | int, Decimal | None] = (0, None)
    reference_option = ""
    advice = "what the drive needs to obey the bus"

    def __init__(self, address: int, options: Any, model: Model | None) -> None:
        self.address, self.options, self.model = address, options, model

    # What a register is

    def place_of(self, address: str) -> Place:
        """Return where an address as the manual prints it is. Raises ParameterAddressError, with how to write one."""
        raise NotImplementedError

    def address_at(self, place: Place) -> str:
        """Return how a message calls a place: as the model does, else by its name."""
        known = self.places.get(place)
        return known.address if known else place.name

    def allowed(self, place: Place) -> range | None:  # noqa: ARG002 - for those who override it
        """Return the numbers that a place can hold, None for those of 16 bits, or of its type."""
        return None

    def is_wide(self, place: Place, type: str) -> bool:  # noqa: ARG002 - for those who override it
        """Whether one place holds 32 bits; else two neighbours do."""
        return "u16" not in self.types

    def control_defaults(self) -> Mapping[str, Any]:
        """Return what the table [control] says besides the model, such as `plain_write` by an option."""
        return {}

    # The master's side

    def reading(self, place: Place, count: int, /) -> Ask:
        """Return the request that reads registers from a place on."""
        raise NotImplementedError

    def writing(self, place: Place, words: Sequence[int], /) -> Ask:
        """Return the request that writes registers from a place on; what must not happen twice is added to it."""
        raise NotImplementedError

    def words(self, reply: Any, place: Place, /) -> tuple[int, ...]:
        """Return the words, unsigned, that the reply to the reading of a place tells."""
        raise NotImplementedError

    def refusal(self, reply: Any) -> int | None:
        """Return the code with which a reply refuses, None for one that does not."""
        raise NotImplementedError

    def refusal_text(self, code: int, called: str) -> str:  # noqa: ARG002 - for those who override it
        """Return what a refusal of `called` means."""
        return self.refusals.get(code, "not listed in the manual")

    def preparing(self, place: Place) -> Ask | None:  # noqa: ARG002 - for those who override it
        """Return what is sent before each request for a place, such as the choice of its page."""
        return None

    def silence_s(self, request: Any) -> float:  # noqa: ARG002 - for those who override it
        """Return how long a drive neither hears nor answers after a request without a reply; 0 where it replies."""
        return 0.0

    def verbs(self, drive: RegisterConversation) -> Mapping[str, Callable[..., Exchange[Any]]]:  # noqa: ARG002
        """Return verbs that only this protocol has, or that few drives have (`Operations.extra`)."""
        return {}

    def reply_kinds_of(self, request: Any) -> Collection[str]:
        """Return the kinds of reply that a request may have, refusals with them."""
        raise NotImplementedError

    def mismatch(self, request: Any, reply: Any) -> str:
        """Name the first field in which a sound reply does not belong to a request; nothing when it belongs."""
        if differs := difference(request, reply, "address", *self.repeats.get("", ())):
            return differs
        if reply.kind not in self.reply_kinds_of(request):
            return "kind"
        return difference(request, reply, *self.repeats.get(reply.kind, ()))

    # The drive's side

    def meant(self, request: Any) -> Access | None:
        """Return what a request to this drive does; None for one that only prepares another. Raises RegisterRefusal."""
        raise NotImplementedError

    def continued(self, request: Any) -> Any:
        """Return what a request means behind the one before it; one of another drive does not concern this one."""
        return request

    def told(self, request: Any, words: Sequence[int]) -> Message:
        """Return the reply to a read."""
        raise NotImplementedError

    def taken(self, request: Any) -> Message:
        """Return the reply to a write, or to what only prepares."""
        raise NotImplementedError

    def refused(self, request: Any, code: int) -> Message:
        """Return the refusal of a request."""
        raise NotImplementedError

    def can_refuse(self, request: Any) -> bool:
        """Whether a drive may refuse a request."""
        return isinstance(request, self.requests)

    def damaged(self, find: Damaged) -> Message | None:  # noqa: ARG002 - for those who override it
        """Return what a drive answers to a telegram that came damaged; None is silence."""
        return None

    def forget(self) -> None:
        """Forget what requests have left behind, as a drive does that starts anew: the page that was chosen."""

    def intent(self, request: Any) -> Intent:
        """Return what a request is for."""
        if not isinstance(request, self.requests):
            return Intent()
        try:
            access = self.meant(request)
        except RegisterRefusal:
            # What this drive does not know, another may obey.
            return Intent(commands=True)
        return Intent(prepares=True) if access is None else Intent(access="read" if access.words is None else "write")

    # What follows from it

    @cached_property
    def shared_addresses(self) -> Collection[int | None]:
        """Addresses at which a drive obeys and does not answer: that of all drives, that of its group."""
        return {self.broadcast_address}

    @cached_property
    def control(self) -> ControlTable:
        """How the drive is commanded and stores: the table [control] of its model."""
        return control_of(type(self), self.options, self.model)

    @cached_property
    def places(self) -> Mapping[Place, ParameterInfo]:
        """The parameters of the model by where they are; of several at one place the first counts."""
        infos = [] if self.model is None else list(self.model.parameters.values())
        return {self.place_of(info.address): info for info in reversed(infos)}

    def target(self, parameter: str, type: str = "") -> Target:
        """Return what is to be read or written. type: instead of the model's.

        Raises ParameterAddressError, and UsageError for a type that it cannot have.
        """
        info = self.model.find(parameter) if self.model is not None else None
        place = self.place_of(info.address if info else parameter)
        info = info or self.places.get(place)
        kind = type or (info.type if info else "") or ("" if "u16" in self.types else self.types[0])
        if kind and kind not in self.types:
            raise UsageError(f"{kind!r} is no type of a {self.title} parameter; types are {', '.join(self.types)}")
        extra = info.extra if info else {}
        low_first = extra.get("word_order", getattr(self.options, "word_order", "high")) == "low"
        size = (int(extra.get("characters", 2)) + 1) // 2 if kind == "string" else 2 if kind.endswith("32") else 1
        wide = kind.endswith("32") and self.is_wide(place, kind)
        if size > 1 and not wide and not self.joins:
            raise UsageError(f"{parameter} cannot be of type {kind}: a {self.title} parameter has 16 bits")
        return Target(
            address=info.address if info else self.address_at(place),
            place=place,
            format=WordFormat(type=kind, size=size, low_first=low_first, allowed=self.allowed(place)),
            wide=wide,
            info=info,
            name=info.name if info and parameter == info.name else "",
        )


@kept
def control_of(dialect: type[Dialect], options: Any, model: Model | None) -> ControlTable:
    """Return the table [control] of a model, or what all have in common, with what a dialect adds to it."""
    if model is None:
        if not dialect.common_model:
            return ControlTable()
        given = tables_beside(str(sys.modules[dialect.__module__].__file__), dialect.common_model)["control"]
        orders = {key: each for key, each in given.items() if key not in CONTROL_PARAMETERS}
        name, none = dialect.title, dict[Any, Any]()
        model = Model(
            protocol=name, name=name, title="", source="", parameters=none, faults=none, options=none, control=orders
        )
    its = dialect(0, options, model)
    return ControlTable(**{**control_entries(model, its.place_of), **its.control_defaults()})
