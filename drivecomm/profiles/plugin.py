"""Plug-in objects of protocols whose drives hold registers, made from a dialect and the telegrams."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from drivecomm.profiles.control_table import CONTROL_KEYS, references_of
from drivecomm.profiles.order_memory import OrderMemory
from drivecomm.protocol import Protocol, later

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles.dialect import Dialect
    from drivecomm.protocol import Codec, LineFacts, Message, Model, Operations, VirtualDrive

_virtual = later("drivecomm.profiles.virtual_registers:VirtualRegisterDrive")


def register_protocol(
    *, dialect: type[Dialect], codec: Callable[[Any], Codec], facts: LineFacts, options: type[Any], **further: Any
) -> Protocol:
    """Return a plug-in object whose fields are derived from the dialect where possible.

    codec: returns the telegrams of drives with these options; a `Telegrams` provides forms, messages and blind spots,
    too. further: other fields of `Protocol`; they override derived ones.
    """

    @cache
    def judge() -> Dialect:
        return dialect(0, options(), None)

    def operations(address: int, own: Any, model: Model | None, memory: OrderMemory | None = None) -> Operations:
        # Imported late, since a master that only listens needs no verbs.
        from drivecomm.profiles.register_operations import RegisterOperations

        made: Operations = RegisterOperations(dialect(address, own, model), memory)
        return made

    def virtual(address: int, own: Any, model: Model) -> VirtualDrive:
        drive: VirtualDrive = _virtual(dialect(address, own, model), codec(own), facts.settings)
        return drive

    def mismatch(request: Message, reply: Message) -> str:
        return judge().mismatch(request, reply)

    usual: dict[str, Any] = {
        "mismatch": mismatch,
        # A new dialect for each request, since it keeps what a request has prepared.
        "intent": lambda request: dialect(0, options(), None).intent(request),
        "operations": operations,
        "virtual": virtual,
        "memory": OrderMemory,
        "broadcast_address": dialect.broadcast_address,
        "control_keys": CONTROL_KEYS,
        "parameter_keys": frozenset({"word_order", "characters", "decimals"}),
        "references": lambda _options, model: references_of(model),
        "refusals": lambda own, model: dialect(0, own, model).refusals,
    }
    if "forms" not in further:
        telegrams: Any = codec(options())
        usual |= {"forms": lambda: telegrams.forms, "message": telegrams.message, "blind_spots": telegrams.blind_spots}
    return Protocol(**{**usual, **further}, codec=codec, facts=facts, options=options)
