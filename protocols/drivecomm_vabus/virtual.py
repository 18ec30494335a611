"""A virtual VABus drive.

Short description sections 6.3 and 6.5; Agile VABus manual p. 30-33; state machine Agile Modbus manual p. 70.

Its watchdog (parameter 413) raises fault F2010 after this many seconds without a correct exchange (ACT/ACU Modbus
manual VEC 383, p. 35). Some behaviour is on no page and was chosen here: every sound telegram to its own node counts,
whatever the answer, and no telegram to all nodes; the time begins with the first of them; the fault also occurs with a
motor at standstill; 0 is off.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError
from drivecomm.profiles import ProfileMachine
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
from drivecomm_vabus import errorcodes
from drivecomm_vabus.conversation import CONTROL_WORD, CURRENT_FAULT, LOCAL_REMOTE, STATE_WORD, profile
from drivecomm_vabus.exchanges import STATE_MACHINE
from drivecomm_vabus.parameters import target
from drivecomm_vabus.store import VabusStore
from drivecomm_vabus.telegrams import BROADCAST, Ack, Enquiry, Nak, Select, Value, data_of, digits_of, telegrams

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Model
    from drivecomm_vabus.options import VabusOptions

_BLOCK_LIST, _BLOCK_WRITE, _BLOCK_READ = 17, 18, 19
_LONGEST_BLOCK = 80
"""Largest number of characters of a block string (Agile VABus manual p. 35)."""
_WATCHDOG_TIME = 413

_WARNING_BIT, _REMOTE_BIT, _REACHED_BIT = 7, 9, 10
"""Bits of the state word (Agile Modbus manual VEC 691 p. 70)."""

_START_CONTACTS = 0b000110
"""Contacts S2 and S3, either of which starts clockwise here.

The configuration of a real drive assigns the contacts. The hardware enable gives the release. Both are the worst case
for a master that takes bits of 410 for commands.
"""

WATCHDOG_FAULT = 0x2010


class VirtualVabusDrive(DriveRepr):
    """An inverter at one node: parameter store, error register with its write lock, state machine, motor."""

    def __init__(self, address: int, options: VabusOptions, model: Model) -> None:
        self.address = address
        self.codec = telegrams()
        self.settings = LineSettings()
        self.gap_s = 0.050
        self.motor = Motor()
        self.store = VabusStore(model, ram_datasets=options.ram_datasets, lower_case_hex=options.lower_case_hex)
        self.store.measured = self._measured()
        self.error_register = 0
        self.locked = False
        self._model = model
        self._options = options
        self._machine = ProfileMachine(profile(), self.motor, lambda _: self._reference_hz(), options.fault_lock_s)
        self._spoken_to_at: float | None = None
        self.store.poke(394, 0, data_of(address, "uint"))

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram: silence for damaged telegrams and those to other drives, NAK for refused requests."""
        if isinstance(find, Damaged):
            self.follow(now)
            return self._complain(find)
        message = find.message
        if not isinstance(message, Enquiry | Select) or message.address not in (self.address, BROADCAST):
            return None
        self.follow(now)
        if message.address == self.address:
            self._spoken_to_at = now
        try:
            reply = self._obey(message, now)
        except Refusal as refusal:
            return self._refuse(refusal.code, broadcast=message.address == BROADCAST)
        return None if message.address == BROADCAST else self._reply(reply)

    def peek(self, parameter: str, now: float) -> str:
        """Return the data characters that an enquiry would get."""
        self.follow(now)
        wanted = target(parameter, self._model, "", None)
        with refusals_as_address_errors(parameter):
            return self._held(wanted.number, wanted.dataset or 0)

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set a parameter's data characters, or its raw number."""
        wanted = target(parameter, self._model, "", None)
        with refusals_as_address_errors(parameter):
            info = self.store.info(wanted.number)
        data = raw if isinstance(raw, str) else data_of(raw, info.type)
        self.store.poke(wanted.number, wanted.dataset or 0, data)

    def trip(self, code: int, now: float) -> None:
        """Trip: output off, code in parameter 260, reset possible after the lock time."""
        self._machine.trip(code, now)

    def power_cycle(self, now: float) -> None:
        """Switch the mains off and on: the RAM data sets, control word, error register and fault are lost."""
        self.follow(now)
        self.store.power_cycle()
        with suppress(Refusal):
            self.store.poke(CONTROL_WORD, 0, data_of(0, "uint"))
        self._machine.power_up(now)
        self.error_register, self.locked = 0, False
        self._spoken_to_at = None

    def follow(self, now: float) -> None:
        """Advance the drive's time: the motor turns, and the state follows a motor that has tripped or stopped."""
        self._watch(now)
        self._machine.follow(now)

    def _obey(self, message: Enquiry | Select, now: float) -> Value | Ack:
        asks_the_register = isinstance(message, Enquiry) and message.parameter == errorcodes.ERROR_REGISTER
        # The register belongs to the interface, in front of the system bus (Agile VABus manual p. 33).
        if message.sys != self._options.sys and not (asks_the_register and message.sys == 0):
            raise Refusal(errorcodes.SYSTEM_BUS_UNREACHABLE)
        if isinstance(message, Enquiry):
            data = self._held(message.parameter, message.dataset)
            if asks_the_register:
                self.error_register, self.locked = 0, False
            place = {"sys": message.sys, "dataset": message.dataset, "parameter": message.parameter}
            return Value(address=self.address, **place, data=data)
        if self.locked:
            # The register keeps the code that caused the lock (section 18 of the specification).
            raise Refusal(self.error_register)
        self._take(message, now)
        return Ack(address=self.address)

    def _held(self, number: int, dataset: int) -> str:
        if dataset and number in (errorcodes.ERROR_REGISTER, _BLOCK_READ):
            raise Refusal(errorcodes.DATASET_NOT_PERMITTED)
        if number == errorcodes.ERROR_REGISTER:
            return data_of(self.error_register, "uint")
        if number == _BLOCK_READ:
            data = "".join(self.store.fetch(listed, place) for listed, place in self._block())
            if not 1 <= len(data) <= _LONGEST_BLOCK:
                raise Refusal(errorcodes.SYNTAX_ERROR)
            return data
        return self.store.fetch(number, dataset)

    def _take(self, select: Select, now: float) -> None:
        if select.parameter == _BLOCK_LIST and len(select.data) > _LONGEST_BLOCK:
            raise Refusal(errorcodes.WRONG_LENGTH)
        if select.parameter != _BLOCK_WRITE:
            self._write(select.parameter, select.dataset, select.data, now)
            return
        if select.dataset % 5:
            raise Refusal(errorcodes.DATASET_NOT_PERMITTED)
        data, block = select.data, [(*listed, digits_of(self.store.info(listed[0]).type)) for listed in self._block()]
        if len(data) != sum(length for _, _, length in block):
            raise Refusal(errorcodes.WRONG_LENGTH)
        for number, dataset, length in block:
            piece, data = data[:length], data[length:]
            self._write(number, dataset, piece, now)

    def _write(self, number: int, dataset: int, data: str, now: float) -> None:
        self.store.write(number, dataset, data, running=self.motor.running)
        if number == CONTROL_WORD:
            self._control_word(self.store.number(CONTROL_WORD), now)
        self.motor.maximum_hz = self._maximum_hz()
        self._machine.act(now)

    def _block(self) -> list[tuple[int, int]]:
        """Return number and data set of each entry of the block list: five characters `S d nnn` each."""
        text = self.store.fetch(_BLOCK_LIST, 0).strip()
        entries = [text[start : start + 5] for start in range(0, len(text), 5)]
        if any(len(entry) != 5 or not entry[1].isdigit() for entry in entries):
            raise Refusal(errorcodes.SYNTAX_ERROR)
        try:
            return [(target(entry[2:], None, "", None).number, int(entry[1])) for entry in entries]
        except ParameterAddressError as error:
            raise Refusal(errorcodes.SYNTAX_ERROR) from error

    def _control_word(self, control: int, now: float) -> None:
        machine = self._machine
        if self.motor.fault or self.store.number(LOCAL_REMOTE) == STATE_MACHINE:
            machine.control(control, now)
        else:
            machine.contacts(control, _START_CONTACTS, now)

    def _maximum_hz(self) -> float:
        return self.store.number(419) / 100 or 50.0

    def _reference_hz(self) -> float:
        """Return the sum of frequency and percentage, within the maximum.

        No page describes how the two are combined (475, 476). A sum is the worst case for a master that sets only one.
        """
        maximum = self._maximum_hz()
        together = self.store.number(480) / 100 + self.store.number(520) / 10000 * maximum
        return max(-maximum, min(maximum, together))

    def _watch(self, now: float) -> None:
        """Trip if the watchdog time has been exceeded, perhaps some time ago."""
        limit_s = self.store.number(_WATCHDOG_TIME)
        if not limit_s or self._spoken_to_at is None or self.motor.fault or now <= self._spoken_to_at + limit_s:
            return
        self.trip(WATCHDOG_FAULT, self._spoken_to_at + limit_s)

    def _measured(self) -> dict[int, Callable[[], float]]:
        """Return the source of each parameter with a measured value, called when it is read."""
        motor, number = self.motor, self.store.number
        return {
            210: lambda: motor.output_hz * 100,
            211: lambda: motor.current_a * 10,
            212: lambda: motor.voltage_v * 10,
            213: lambda: motor.power_kw * 10,
            222: lambda: motor.dc_link_v * 10,
            224: lambda: motor.torque_nm * 10,
            228: lambda: motor.target_hz * 100,
            230: lambda: number(520),
            240: lambda: motor.speed_rpm,
            241: lambda: motor.shaft_hz * 100,
            255: lambda: motor.temperature_c * 10,
            256: lambda: motor.ambient_c * 10,
            CURRENT_FAULT: lambda: motor.fault,
            270: lambda: motor.warning,
            282: lambda: number(480),
            283: lambda: self._reference_hz() * 100,
            STATE_WORD: self._state_word,
        }

    def _state_word(self) -> int:
        motor, remote = self.motor, self.store.number(LOCAL_REMOTE) == STATE_MACHINE
        shown = motor.warning << _WARNING_BIT | motor.at_reference << _REACHED_BIT
        return self._machine.status_word() | shown | remote << _REMOTE_BIT

    def _complain(self, find: Damaged) -> VirtualReply | None:
        """Refuse a wrong BCC or text in a select for this drive; answer a broken structure with silence."""
        to_us = len(find.data) > 2 and find.data[1] - 0x40 == self.address and find.data[2:3] == b"\x02"
        code = {"checksum": errorcodes.CHECKSUM_ERROR, "field": errorcodes.SYNTAX_ERROR}.get(find.error.category)
        if not to_us or code is None or find.error.field == "address":
            return None
        return self._refuse(code, broadcast=False)

    def _refuse(self, code: int, *, broadcast: bool) -> VirtualReply | None:
        self.error_register, self.locked = code, True
        if broadcast or code in self._options.silent_on:
            return None
        return self._reply(Nak(address=self.address))

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse a request with this code, and any write after it until the error register is read."""
        self.follow(now)
        return self._refuse(code, broadcast=getattr(find.message, "address", BROADCAST) == BROADCAST)

    def _reply(self, message: Value | Ack | Nak) -> VirtualReply:
        return VirtualReply(data=self.codec.encode(message), delay_s=self._options.reply_delay_s)
