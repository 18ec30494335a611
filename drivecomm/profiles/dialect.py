"""Dialects: how the telegrams of a protocol carry registers."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from drivecomm.errors import UsageError
from drivecomm.profiles.control_table import CONTROL_PARAMETERS, ControlTable, control_entries
from drivecomm.profiles.register_machine import RegisterRefusal
from drivecomm.profiles.registers import RegisterParameter, RegisterPlace
from drivecomm.protocol import WORD_TYPES, Intent, Model, WordFormat, cached, difference, tables_beside

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from decimal import Decimal

    from drivecomm.profiles.register_conversation import RegisterConversation
    from drivecomm.protocol import Ask, Damaged, Exchange, Message, ParameterInfo


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Effect of a request: it reads registers from a place on, or writes words there.

    count: the number of registers to read. words: the words to write, None for a read. only_ram: whether the write goes
    to RAM on a drive whose other writes go to EEPROM.
    """

    place: RegisterPlace
    count: int = 1
    words: tuple[int, ...] | None = None
    only_ram: bool = False


class Dialect:
    """The registers of one drive, and the telegrams that read and write them."""

    title: ClassVar[str]
    common_model: ClassVar[str] = ""
    broadcast_address: ClassVar[int | None] = None
    requests: ClassVar[type[Any] | tuple[type[Any], ...]] = object
    probe: RegisterPlace = RegisterPlace("", 0)
    identity: Mapping[str, str] = {}
    repeats: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    refusals: Mapping[int, str] = {}
    codes: Mapping[str, int] = {}
    reason: RegisterPlace | None = None
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

    # Registers and their places

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of an address as the manual prints it. Raises ParameterAddressError."""
        raise NotImplementedError

    def address_at(self, place: RegisterPlace) -> str:
        """Return the address of a place for messages: that of the model, or else the name of the place."""
        known = self.places.get(place)
        return known.address if known else place.name

    def allowed(self, place: RegisterPlace) -> range | None:  # noqa: ARG002 - overriding methods use it
        """Return the numbers that a place can hold; None for all numbers of 16 bits or of its type."""
        return None

    def is_wide(self, place: RegisterPlace, type: str) -> bool:  # noqa: ARG002 - overriding methods use it
        """Return whether one place holds 32 bits; if not, two neighbours do."""
        return "u16" not in self.types

    def control_defaults(self) -> Mapping[str, Any]:
        """Return entries of the table [control] that override those of the model, such as `plain_write`."""
        return {}

    # Methods for a master

    def reading(self, place: RegisterPlace, count: int, /) -> Ask:
        """Return the request that reads registers from a place on."""
        raise NotImplementedError

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the request that writes registers from a place on; callers restrict its repetition if necessary."""
        raise NotImplementedError

    def words(self, reply: Any, place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the words, unsigned, in the reply to a read of a place."""
        raise NotImplementedError

    def refusal(self, reply: Any) -> int | None:
        """Return the code with which a reply refuses; None if the reply is not a refusal."""
        raise NotImplementedError

    def refusal_text(self, code: int, called: str) -> str:  # noqa: ARG002 - overriding methods use it
        """Return the meaning of a refusal code.

        called: what was refused.
        """
        return self.refusals.get(code, "not listed in the manual")

    def preparing(self, place: RegisterPlace) -> Ask | None:  # noqa: ARG002 - overriding methods use it
        """Return the request to send before each request for a place, such as the choice of its page, if any."""
        return None

    def silence_s(self, request: Any) -> float:  # noqa: ARG002 - overriding methods use it
        """Return the seconds for which a drive is deaf and silent after a request without a reply; 0 if it replies."""
        return 0.0

    def verbs(self, drive: RegisterConversation) -> Mapping[str, Callable[..., Exchange[Any]]]:  # noqa: ARG002
        """Return verbs that only this protocol has, or that few drives have (`Operations.extra`)."""
        return {}

    def reply_kinds_of(self, request: Any) -> Collection[str]:
        """Return the possible kinds of reply to a request, including refusals."""
        raise NotImplementedError

    def mismatch(self, request: Any, reply: Any) -> str:
        """Return the first field in which a sound reply does not belong to a request; empty if it belongs."""
        if differs := difference(request, reply, "address", *self.repeats.get("", ())):
            return differs
        if reply.kind not in self.reply_kinds_of(request):
            return "kind"
        return difference(request, reply, *self.repeats.get(reply.kind, ()))

    # Methods for a virtual drive

    def access_of(self, request: Any) -> Access | None:
        """Return the effect of a request to this drive, None if it only prepares another. Raises RegisterRefusal."""
        raise NotImplementedError

    def complete_request(self, request: Any) -> Any:
        """Return a request that names no drive, completed from the one before; other requests stay as they are."""
        return request

    def read_reply(self, request: Any, words: Sequence[int]) -> Message:
        """Return the reply to a read."""
        raise NotImplementedError

    def write_reply(self, request: Any) -> Message:
        """Return the reply to a write, or to a request that only prepares another one."""
        raise NotImplementedError

    def refusal_reply(self, request: Any, code: int) -> Message:
        """Return the refusal of a request."""
        raise NotImplementedError

    def can_refuse(self, request: Any) -> bool:
        """Return whether a drive may refuse a request."""
        return isinstance(request, self.requests)

    def damage_reply(self, find: Damaged) -> Message | None:  # noqa: ARG002 - overriding methods use it
        """Return the reply of a drive to a damaged telegram; None if the drive stays silent."""
        return None

    def forget(self) -> None:
        """Forget the state that requests have left behind, such as the chosen page, as a restarting drive does."""

    def intent(self, request: Any) -> Intent:
        """Return the purpose of a request."""
        if not isinstance(request, self.requests):
            return Intent()
        try:
            access = self.access_of(request)
        except RegisterRefusal:
            # Another drive may obey a request that this one does not know.
            return Intent(commands=True)
        return Intent(prepares=True) if access is None else Intent(access="read" if access.words is None else "write")

    # Properties that follow from the methods above

    @cached_property
    def shared_addresses(self) -> Collection[int | None]:
        """Addresses at which a drive obeys and does not answer: the broadcast address, and the address of its group."""
        return {self.broadcast_address}

    @cached_property
    def control(self) -> ControlTable:
        """The table [control] of the model, by which the drive is commanded and stores."""
        return control_of(type(self), self.options, self.model)

    @cached_property
    def places(self) -> Mapping[RegisterPlace, ParameterInfo]:
        """Parameters of the model by place; of several at one place, the first counts."""
        infos = [] if self.model is None else list(self.model.parameters.values())
        return {self.place_of(info.address): info for info in reversed(infos)}

    def target(self, parameter: str, type: str = "") -> RegisterParameter:
        """Return the parameter to read or write.

        type: overrides the type of the model. Raises ParameterAddressError, and UsageError for a type that the
        parameter cannot have.
        """
        info = self.model.find(parameter) if self.model is not None else None
        place = self.place_of(info.address if info else parameter)
        info = info or self.places.get(place)
        kind = type or (info.type if info else "") or ("" if "u16" in self.types else self.types[0])
        if kind and kind not in self.types:
            raise UsageError(f"{kind!r} is not a type of a {self.title} parameter; types are {', '.join(self.types)}")
        extra = info.extra if info else {}
        low_first = extra.get("word_order", getattr(self.options, "word_order", "high")) == "low"
        size = (int(extra.get("characters", 2)) + 1) // 2 if kind == "string" else 2 if kind.endswith("32") else 1
        wide = kind.endswith("32") and self.is_wide(place, kind)
        if size > 1 and not wide and not self.joins:
            raise UsageError(f"{parameter} cannot be of type {kind}: a {self.title} parameter has 16 bits")
        return RegisterParameter(
            address=info.address if info else self.address_at(place),
            place=place,
            format=WordFormat(type=kind, size=size, low_first=low_first, allowed=self.allowed(place)),
            wide=wide,
            info=info,
            name=info.name if info and parameter == info.name else "",
        )


@cached
def control_of(dialect: type[Dialect], options: Any, model: Model | None) -> ControlTable:
    """Return the table [control] of a model, or the common one of the dialect, with the dialect's own entries."""
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
