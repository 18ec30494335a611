"""The plug-in object of a protocol whose drives hold registers, out of its dialect and its telegrams."""

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
    """Return the plug-in object: what follows from the dialect is filled in, the rest are fields of `Protocol`.

    codec: the telegrams of drives with these options; of a `Telegrams`, forms, messages and blind spots are taken, too.
    A field that is given is taken in place of what would follow.
    """

    @cache
    def judge() -> Dialect:
        return dialect(0, options(), None)

    def operations(address: int, own: Any, model: Model | None, memory: OrderMemory | None = None) -> Operations:
        # A master that only looks on needs no verbs.
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
        # A new one each time: a drive keeps what a request has prepared.
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
