"""A virtual Fuji inverter.

FVR-E11S manual 9-16 to 9-20; FRENIC5000G11S RS-485 manual p. 13; FRENIC-VG option manual 5-13 to 5-39; HVAC/AQUA RS-485
manual 4-4 to 4-17; sections 2, 5, 8 and 9 of the specification. Frames with a wrong sum are not answered, so that
several inverters do not answer simultaneously (FRENIC5000G11S technical information 2-57).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.protocol import (
    Damaged,
    DriveRepr,
    Framed,
    LineSettings,
    Motor,
    Refusal,
    VirtualReply,
    refusals_as_address_errors,
)
from drivecomm.protocol.schema import hex_sum
from drivecomm_fuji import generations as codes, words
from drivecomm_fuji.codec import FujiReceivingCodec
from drivecomm_fuji.generations import slow_write
from drivecomm_fuji.machine import FujiMachine
from drivecomm_fuji.parameters import target
from drivecomm_fuji.store import FujiStore
from drivecomm_fuji.telegrams import BROADCAST, ENQ, Frame, PollFrame, SelectFrame, StandardFrame
from drivecomm_fuji.words import COMMAND

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_fuji.options import FujiOptions

_BY_ROUTE = frozenset(["S01", "S05", "S06", "S13"])
"""Functions that the link may write only if H30 gives it the right (HVAC/AQUA manual 4-17)."""

_BUSY_S = 0.1
"""Seconds for which a parameter written by command A is being stored."""

_CODES = {"command": codes.COMMAND_ERROR, "function": codes.FUNCTION_ERROR, "data": codes.DATA_ERROR}


class VirtualFujiDrive(DriveRepr):
    """An inverter at one station: functions, M26, operation command with its route, alarm memory, motor.

    `machine` holds the motor's state, the measured values, and the frequency set at the keypad.
    """

    def __init__(self, address: int, options: FujiOptions, model: Model) -> None:
        self.address = address
        self.settings = LineSettings()
        self.gap_s = 0.050
        self.motor = Motor()
        self._profile = options.generation
        self.codec = FujiReceivingCodec(self._profile)
        self.store = FujiStore(model, options)
        self.machine = FujiMachine(self.motor, self.store, options)
        self._options = options
        self._model = model

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a request: stay silent for a wrong sum and at station 99, and answer a refused request with a NAK."""
        if isinstance(find, Damaged):
            return self._complain(find, now)
        self.machine.live(now)
        message = find.message
        if not isinstance(message, Frame):
            return None
        if message.address not in (self.address, BROADCAST):
            self.machine.silence.overheard(now)
            return None
        self.machine.silence.heard(now)
        if message.address == BROADCAST and not self._heeds(message):
            return None
        try:
            answer, needs_s = self._obey(message, now)
        except Refusal as refusal:
            self.store.set(words.ERROR, refusal.code)
            answer, needs_s = _nak(message, refusal.code), 0.0
        return None if message.address == BROADCAST else self._reply(answer, needs_s)

    def peek(self, parameter: str, now: float) -> int:
        """Return the value of a function in the form of `Reading.raw`."""
        self.machine.live(now)
        with refusals_as_address_errors(parameter):
            return self.store.word(target(parameter, self._model, self._options).function)

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set the value of a function; a measured value is soon overwritten."""
        function = target(parameter, self._model, self._options).function
        number = int(raw)
        with refusals_as_address_errors(parameter):
            self.store.poke(function, number if function in self._profile.sign_functions else number % 0x10000)
        # Drop the cached measurement, so that an alarm before the next request stores the value that was set here.
        self.machine.latest.pop(function, None)

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on: commands (S codes) and an alarm are lost, the alarm memory stays."""
        self.machine.live(now)
        self.machine.power_up(now)

    def overhear(self, now: float) -> None:
        """Record a sound telegram to another station."""
        if self.machine.silence.is_over(now):
            self.machine.live(now)
        self.machine.silence.overheard(now)

    def follow(self, now: float) -> None:
        """Advance the inverter to the time `now`."""
        self.machine.live(now)

    def trip(self, code: int, now: float) -> None:
        """Trip with this alarm code: output off, memory M16 to M19 shifted, values at the alarm kept."""
        self.machine.trip(code, now)

    def _heeds(self, message: Frame) -> bool:
        """Return whether a request at station 99 is executed: W of some S codes, E, a-f and m."""
        if isinstance(message, StandardFrame):
            writes = message.command == "W" and self._profile.takes_from_all(message.function or "")
            return writes or message.command == "E"
        return isinstance(message, SelectFrame)

    def _obey(self, message: Frame, now: float) -> tuple[Frame, float]:
        """Return the ACK, and the seconds that it needs beyond the usual time. Raises Refusal."""
        command, data = message.command, message.data or 0
        if command not in self._profile.all_commands:
            raise Refusal(codes.COMMAND_ERROR)
        if isinstance(message, PollFrame):
            word = self.store.fetch(self._profile.poll[command])
            return replace(message, kind="ack", data=word % 0x10000 if self._options.signed_j else abs(word)), 0.0
        if command in ("E", "m"):
            if data:
                raise Refusal(codes.DATA_ERROR)
            self.machine.reset(now)
            return replace(message, kind="ack", data=None), 0.0
        if isinstance(message, SelectFrame):
            self._write(self._profile.select[command], data, now)
            return replace(message, kind="ack", data=None), 0.0
        function = message.function or ""
        if self._profile.refusal_of(function, number_check=True):
            raise Refusal(codes.FUNCTION_ERROR)
        if command == "R":
            word = self.store.fetch(function)
            return replace(message, kind="ack", data=abs(word), negative=word < 0), 0.0
        self._write(function, data, now)
        slow = slow_write(function, data)
        # FRENIC-VG treats A like W (option manual 5-20).
        if slow and command == "A" and codes.WRITE_BUSY in self._profile.error_codes:
            self.machine.busy_until = now + _BUSY_S
            slow = None
        answer = replace(message, kind="ack", data=data if self._profile.echoes_writes else 0)
        return answer, slow.needs_s if slow else 0.0

    def _write(self, function: str, data: int, now: float) -> None:
        if function in _BY_ROUTE and self._profile.checks_route and not self.machine.has_right(function):
            raise Refusal(codes.LINK_PRIORITY)
        self.store.check(function, data, running=self.motor.running)
        if function == COMMAND and data & ~self._profile.command_mask:
            raise Refusal(codes.DATA_ERROR)
        if function[0] != "S" and now < self.machine.busy_until:
            raise Refusal(codes.WRITE_BUSY)
        self.store.poke(function, data)
        if function == COMMAND:
            self.machine.obey(data, now)
        if function == "H03" and data:
            self.store.initialise("P" if data == 2 else self._profile.types.replace("S", "").replace("M", ""))
        if function in ("P04", "A13"):
            # Tuning has ended when it is acknowledged.
            self.store.poke(function, 0)
        self.machine.live(now)

    def _complain(self, damage: Damaged, now: float) -> VirtualReply | None:
        """Return the reply to a damaged request: None for silence, or a NAK whose code M26 then holds.

        FRENIC5000G11S RS-485 manual p. 13, FRENIC-VG option manual 5-27: section 2.6 of the specification.
        """
        data = damage.data
        if data[1:3] != b"%02d" % self.address or len(data) not in (8, 12, 16) or damage.error.category == "length":
            return None
        self.machine.live(now)
        if hex_sum(data[1:-2]) != data[-2:]:
            self.store.set(words.ERROR, codes.CHECKSUM_ERROR)
            return None
        is_request, command = data[3:4] == ENQ, chr(data[4])
        code = _CODES.get(damage.error.field, codes.FORMAT_ERROR) if is_request else codes.FORMAT_ERROR
        self.store.set(words.ERROR, code)
        if is_request and len(data) < 16 and code != codes.COMMAND_ERROR:
            kind: type[SelectFrame | PollFrame] = SelectFrame if len(data) == 12 else PollFrame
            return self._reply(kind(kind="nak", address=self.address, command=command), 0.0)
        # The reply to an unlisted command has command R, so that a host knows its length.
        command, echo = command if command in "RWAE" else "R", data[5:8].decode("latin-1")
        nak = StandardFrame(kind="nak", address=self.address, command=command, function=echo, error_code=code)
        return self._reply(nak, 0.0)

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse a request with this code, which M26 then holds."""
        message = find.message
        if not isinstance(message, Frame) or message.address == BROADCAST:
            return None
        self.machine.live(now)
        self.store.set(words.ERROR, code)
        return self._reply(_nak(message, code), 0.0)

    def _reply(self, message: Frame, needs_s: float) -> VirtualReply:
        delay = self._options.response_interval_s + self._profile.processing_ms / 1000 + needs_s
        return VirtualReply(data=self.codec.encode(message), delay_s=delay)


def _nak(message: Frame, code: int) -> Frame:
    if isinstance(message, StandardFrame):
        return replace(message, kind="nak", function=message.function or "   ", data=None, error_code=code)
    return replace(message, kind="nak", data=None)
