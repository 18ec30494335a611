"""A virtual Modbus drive, defined by the table [control] of its series' model."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.profiles import RegisterRefusal, VirtualRegisterDrive
from drivecomm.protocol import Damaged, Framed, LineSettings, VirtualReply
from drivecomm_modbus import functions as fn
from drivecomm_modbus.dialect import ModbusDialect
from drivecomm_modbus.framings import drive_codec
from drivecomm_modbus.messages import Reply, Request
from drivecomm_modbus.telegrams import BROADCAST

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_modbus.options import ModbusOptions

_KINDS = {1: "c", 2: "d", 3: "", 4: "i", 5: "c", 6: "", 0x0F: "c", 0x10: "", 0x64: "", 0x65: "", 0x17: ""}
_HEARD, _DAMAGED, _REFUSED, _OWN = 11, 12, 13, 14
"""Counters, by the sub-function of 08 that returns them."""
_RESTART, _CLEAR, _EVENTS = 1, 10, -1


class VirtualModbusDrive(VirtualRegisterDrive):
    """A drive at one address. It obeys a command when its last step is written and the earlier ones came before it."""

    def __init__(self, address: int, options: ModbusOptions, model: Model) -> None:
        dialect = ModbusDialect(address, options, model)
        self._frames = drive_codec(options)
        super().__init__(dialect, self._frames, LineSettings())
        self._options, self._control = options, dialect.control
        usual = [each for each in _KINDS if options.wide_functions or each not in (fn.READ_LONG, fn.WRITE_LONG)]
        self._functions = self._control.functions or [*usual, fn.DIAGNOSTICS, self._control.identification or 0]
        self._counts: Counter[int] = Counter()
        # If an address holds 32 bits, a telegram is for exactly one parameter.
        wide = self._targets.values() if options.wide_functions else ()
        self._sizes = {each.place.name: each.format.size for each in wide}

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram: silence for damaged telegrams and those to others, an exception for refused requests."""
        if isinstance(find, Damaged):
            self._counts[_DAMAGED] += find.error.category == "checksum"
        else:
            self._counts[_HEARD] += 1
            own = isinstance(find.message, Request) and find.message.address in (self.address, BROADCAST)
            self._counts[_OWN] += own
        return super().hear(find, now)

    def answer(self, request: Any, now: float) -> Reply:
        """Carry out a request, and return the reply. Raises RegisterRefusal."""
        reply = self._reply(request, now)
        if reply.exception is None and request.function != fn.EVENT_COUNTER:
            self._counts[_EVENTS] += 1
        return replace(reply, transaction=request.transaction)

    def complain(self, find: Damaged) -> Reply | None:
        """Return exception 1 or 3 for a sound telegram with a wrong function or field, None for any other damage."""
        if find.error.category != "field":
            return None
        content = self._frames.content(find.data)
        if content[0] != self.address:
            return None
        refusing = self._refusing(content[1] & 0x7F, find.error.field)
        return replace(refusing, transaction=self._frames.transaction(find.data))

    def refuse(self, request: Any, why: str) -> Reply:
        """Return the exception for a refused request."""
        return replace(self._refusing(request.function, why), transaction=request.transaction)

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse a request with this exception."""
        self.follow(now)
        request: Any = find.message
        self._counts[_REFUSED] += 1
        reply = Reply(address=self.address, function=request.function, exception=code)
        return self._sent(replace(reply, transaction=request.transaction))

    def _refusing(self, function: int, why: str) -> Reply:
        self._counts[_REFUSED] += 1
        return Reply(address=self.address, function=function, exception=self._dialect.codes.get(why, 3))

    def _reply(self, message: Request, now: float) -> Reply:
        function, start = message.function, message.start or 0
        if function not in self._functions:
            return self._refusing(function, "function")
        same: dict[str, Any] = {"address": self.address, "function": function}
        if function == fn.DIAGNOSTICS:
            return self._diagnosis(same, message)
        if function == fn.EVENT_COUNTER:
            return Reply(**same, status=0, event_count=self._counts[_EVENTS] & 0xFFFF)
        if function == self._control.identification:
            return self._identity(same, message)
        kind = _KINDS[function]
        if function == fn.READ_LONG:
            return Reply(**same, value=self._machine.read([str(start)])[0])
        if message.values is not None:
            first = start if message.write_start is None else message.write_start
            self._write(kind, first, message.values, now, for_all=message.address == BROADCAST)
            if function != fn.READ_WRITE:
                return Reply(**same, start=start, count=len(message.values))
            self._machine.live(now)
        elif message.value is not None:
            self._write(kind, start, (message.value,), now, for_all=message.address == BROADCAST)
            return Reply(**same, start=start, value=message.value)
        values = self._fetch(kind, start, message.count or 0)
        if kind in ("c", "d"):
            values += (0,) * (-len(values) % 8)
        return Reply(**same, values=values)

    def _diagnosis(self, same: dict[str, Any], message: Request) -> Reply:
        asked = message.sub_function or 0
        if asked not in self._control.diagnostics:
            return self._refusing(message.function, "sub_function")
        if asked in (_RESTART, _CLEAR):
            self._counts.clear()
        # The diagnostic register, 2, has no bit that this drive sets.
        told = message.value if asked in (0, _RESTART, _CLEAR) else self._counts[asked] & 0xFFFF
        return Reply(**same, sub_function=asked, value=told)

    def _identity(self, same: dict[str, Any], message: Request) -> Reply:
        if message.function == fn.REPORT_ID:
            return Reply(**same, data=f"{self.address:02X} FF")
        texts = dict(enumerate(("drivecomm", self._model.title.encode("ascii", "replace").decode(), "1.0")))
        first, single = message.object_id or 0, message.read_code == 4
        if single and first not in texts:
            raise RegisterRefusal("unknown")
        told = (first,) if single else tuple(texts)[first:] or tuple(texts)
        same |= {"read_code": message.read_code, "conformity": 0x81, "more_follows": 0, "next_object": 0}
        return Reply(**same, object_ids=told, texts=tuple(texts[each] for each in told))

    def _fetch(self, kind: str, start: int, count: int) -> tuple[int, ...]:
        if size := self._sizes.get(f"{kind}{start}"):
            if count != size:
                raise RegisterRefusal("count")
            (word,) = self._machine.read([f"{kind}{start}"])
            return (word >> 16, word & 0xFFFF)[-size:]
        if kind in ("", "i") and count > self._options.max_registers:
            raise RegisterRefusal("count")
        if kind == "i" and f"i{start}" not in self._machine.words:
            kind = ""  # most drives have no separate input registers
        return self._machine.read(f"{kind}{place}" for place in range(start, start + count))

    def _write(self, kind: str, start: int, values: tuple[int, ...], now: float, *, for_all: bool) -> None:
        offset = 0 if f"{kind}{start}" in self._machine.words else self._control.volatile_offset
        if len(values) == self._sizes.get(f"{kind}{start - offset}", 1) == 2:
            values = (values[0] << 16 | values[1],)
        places = [f"{kind}{place - offset}" for place in range(start, start + len(values))]
        if for_all and self._control.broadcasts and not self._control.broadcasts.issuperset(places):
            raise RegisterRefusal("unknown")
        self._machine.write(places, values, now, only_ram=offset > 0)
