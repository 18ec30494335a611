"""Verbs of a master for a Modbus drive, defined by the table [control] of its model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.errors import NoReplyError, RefusedError, ReplyError
from drivecomm.profiles import RegisterOperations
from drivecomm.protocol import Ask, SeriesFound, unless_refused, without_repeats
from drivecomm_modbus import functions as fn
from drivecomm_modbus.conversation import ModbusConversation
from drivecomm_modbus.dialect import ModbusDialect
from drivecomm_modbus.evidence import candidates, evidence_for
from drivecomm_modbus.memory import ModbusMemory
from drivecomm_modbus.messages import Request
from drivecomm_modbus.parameters import counting_hint

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from drivecomm.profiles import RegisterParameter
    from drivecomm.protocol import Exchange, Model, Reading
    from drivecomm_modbus.options import ModbusOptions

_OBJECTS = {0: "vendor", 1: "product", 2: "software"}


class ModbusOperations(RegisterOperations):
    """Verbs of one drive, or at address 0 the stop of all drives of a series on the line."""

    def __init__(
        self, address: int, options: ModbusOptions, model: Model | None, memory: ModbusMemory | None = None
    ) -> None:
        dialect, memory = ModbusDialect(address, options, model), memory or ModbusMemory()
        super().__init__(dialect, memory, ModbusConversation(dialect, memory))
        self._address, self._options, self._identification_code = address, options, dialect.control.identification

    def _told(self, wanted: RegisterParameter, raw: int | str) -> Reading:
        reading = super()._told(wanted, raw)
        if self._model is None and (hint := counting_hint(wanted.address, self._options)):
            return replace(reading, note=f"{reading.note or 'no model'}; {hint}")
        return reading

    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:
        """Read the identity as the model defines it; without a model, the standard identification or function 11H."""
        found = dict((yield from super().identify(only)))
        if only and self._dialect.identity.keys() >= set(only):
            return found
        tried = (fn.IDENTIFICATION, fn.REPORT_ID) if self._model is None else (self._identification_code,)
        for function in filter(None, tried):
            told = yield from unless_refused(self._identification(function), ReplyError)
            if told is None:
                break  # the drive does not answer unknown functions
            if told:
                return {**found, **told}
        return found

    def check_series(self, others: Sequence[Model]) -> Exchange[SeriesFound]:
        """Read the status and registers that distinguish the model from others; a refusal is evidence against it."""
        model = self._model
        if model is None:
            return SeriesFound()
        plan = evidence_for(model, self._options, tuple(others))
        for number, wanted in enumerate(plan.present):
            try:
                yield from self._drive.raw(wanted)
            except RefusedError as error:
                if error.code == fn.BUSY:
                    raise
                fitting = candidates(others, plan.present[:number], wanted)
                return SeriesFound(against=str(error), candidates=fitting)
        for wanted in plan.absent:
            told = yield from unless_refused(without_repeats(self._drive.raw(wanted)), NoReplyError)
            if told is not None:
                return SeriesFound(
                    against=f"it has register {wanted.place.name} of the telegram, which such a drive lacks",
                    candidates=candidates(others, [*plan.present, wanted]),
                )
        if plan.knows and not (yield from self._identification(plan.knows)):
            return SeriesFound(
                against=f"it does not support function {plan.knows}, by which such a drive reports its identity"
            )
        if plan.lacks and (texts := (yield from unless_refused(self._identification(plan.lacks), NoReplyError))):
            return SeriesFound(
                against=f"it reports its identity, {', '.join(texts.values())}, which such a drive does not"
            )
        if plan.titled:
            named = yield from unless_refused(self._identification(fn.IDENTIFICATION), NoReplyError)
            name = plan.titled.get((named or {}).get("product", ""))
            if name == model.name:
                return SeriesFound()
            if name:
                return SeriesFound(against=f"it reports that it is of model {name}", candidates=(name,))
        return SeriesFound(open=plan.open)

    def _identification(self, function: int) -> Exchange[dict[str, str]]:
        """Return the identity that the drive reports; empty if it refuses."""
        code, first = (1, 0) if function == fn.IDENTIFICATION else (None, None)
        request = Request(address=self._address, function=function, read_code=code, object_id=first)
        reply = yield Ask(message=request, attempts=1, nameless=True)
        if reply.exception is not None:
            return {}
        if function == fn.REPORT_ID:
            return {"id": reply.data}
        pairs = zip(reply.object_ids, reply.texts, strict=True)
        return {_OBJECTS.get(number, f"object {number}"): text.strip() for number, text in pairs}
