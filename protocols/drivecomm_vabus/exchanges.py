"""Verbs of a VABus master: read, write, control, status.

The control word, parameter 410, is a command only while parameter 412 is 1. While 412 is 2, and perhaps with other
values that no page lists, bits 0 to 5 switch the contacts S1 to S6, and the drive's configuration decides which of them
starts the motor: 0007 and 0002, which stop by the state machine, may then start it. 0000 stops in every mode, and is
the only word that switches no contact on. Agile Modbus manual VEC 691 p. 70; ACT/ACU Modbus manual VEC 383 p. 72;
contacts: ACT fieldbus manual 06/05 p. 41.
"""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import (
    NotSupported,
    ParameterAddressError,
    RefusedError,
    ReplyError,
    StateError,
    UnexpectedReplyError,
    UsageError,
)
from drivecomm.protocol import Capabilities, Stop, cached, check_store, needs_answer, unless_refused, without_repeats
from drivecomm_vabus.conversation import (
    CONTROL_WORD,
    CURRENT_FAULT,
    LOCAL_REMOTE,
    STATE_WORD,
    VabusConversation,
    VabusMemory,
    profile,
)
from drivecomm_vabus.parameters import VabusTarget, characters_for, reading_of, target
from drivecomm_vabus.references import VabusReferences
from drivecomm_vabus.telegrams import BROADCAST

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from drivecomm.profiles import Commander
    from drivecomm.protocol import DriveStatus, Exchange, Model, Reading, Value as ParameterValue
    from drivecomm_vabus.options import VabusOptions

STATE_MACHINE = 1
"""Value of parameter 412 with which the control word commands; with 2 its bits 0 to 5 are contacts.

Other values are on no page.
"""

DISABLE_VOLTAGE = 0x0000

BLOCK_TO_WRITE = 18
"""The parameter that writes several others (model family, "block: values to write")."""


class VabusOperations:
    """Verbs of one VABus drive, or of all drives at address 32."""

    def __init__(
        self, address: int, options: VabusOptions, model: Model | None, memory: VabusMemory | None = None
    ) -> None:
        self.answers = address != BROADCAST
        self._options = options
        self._model = model
        self._memory = memory or VabusMemory()
        self._talk = VabusConversation(address, options, self._memory)
        self._references = VabusReferences(self._talk, options, model)
        self._known = cached(lambda name, kind: target(name, model, kind, None))

    @property
    def capabilities(self) -> Capabilities:
        """The abilities of a VABus drive."""
        return Capabilities(
            stops=frozenset(profile().stops) if self.answers else frozenset({Stop.COAST}),
            reverse=self._options.ram_datasets,
            reference_percent=self._options.ram_datasets,
            reference_hz=self._options.ram_datasets,
            stored_writes=True,
            volatile_writes=self._options.ram_datasets,
            broadcast=True,
            reference_maximum=self._references.maximum,
        )

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """An additional verb: control_word(word=) writes parameter 410 unchanged, once."""
        return {"control_word": self.control_word}

    @needs_answer
    def read(self, parameter: str, *, type: str = "", dataset: int | None = None) -> Exchange[Reading]:
        """Read a parameter. type: uint, int, long or string. dataset: 0 to 4."""
        wanted = self._known(parameter, type) if dataset is None else target(parameter, self._model, type, dataset)
        if wanted.dataset is not None and wanted.dataset > 4:
            raise ParameterAddressError(
                f"data set {wanted.dataset} of parameter {parameter} can only be written; read data set "
                f"{wanted.dataset - 5}, of which it is the RAM side"
            )
        return self._read_target(wanted)

    def write(
        self,
        parameter: str,
        value: ParameterValue | float,
        *,
        store: bool = False,
        type: str = "",
        dataset: int | None = None,
    ) -> Exchange[None]:
        """Write a parameter. type: uint, int, long or string. dataset: 0 to 4, or 5 to 9 for their RAM side."""
        wanted = target(parameter, self._model, type, dataset)
        attempts = 1 if wanted.number == CONTROL_WORD else None
        dataset_sent = self._write_dataset(wanted, store=store)
        return self._talk.select(wanted.number, dataset_sent, characters_for(wanted, value), attempts=attempts)

    def address_of(self, parameter: str, *, dataset: int | None = None, **_: Any) -> str:
        """Return number and data set of a parameter; data set 0 is the default and is left out."""
        wanted = target(parameter, self._model, "", dataset)
        return wanted.address if wanted.dataset else str(wanted.number)

    @needs_answer
    def status(self) -> Exchange[DriveStatus]:
        """Read the state word, and the fault code if the state is a fault."""
        return self._commander().status(self._model)

    @needs_answer
    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Step the state machine to "operation enabled": 0006, 0007, 000F, waiting for each state.

        The control word has no bit for the direction; the sign of the references determines it (Agile VABus manual
        p. 41). So the references get the sign of this direction first, in RAM. Raises StateError if the state machine
        is not in charge (parameter 412), or if the motor would still turn the other way.
        """
        if reverse and not self._options.ram_datasets:
            raise NotSupported(
                "this drive has no RAM data sets, and a reversed reference would go to EEPROM; "
                "write a negative reference with store=True, and its control words with control_word",
                says="store=True",
            )
        return self._start(reverse=reverse)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop: 0007 (disable operation), 0000 (coast) or 0002 (quick stop).

        In remote contacts (parameter 412) 0007 and 0002 could start a motor, so every stop is 0000 then, and the drive
        decides how the motor runs down. 412 is read once. If no reply comes, 0000 is sent immediately, unless this
        program has started the motor: then the requested word only clears bits. A broadcast cannot read 412, so all
        drives get 0000.
        """
        if how not in profile().stops:
            raise NotSupported(f"VABus has no {how.value} stop; use ramp, coast or quick")
        if not self.answers:
            return self._talk.command(DISABLE_VOLTAGE, urgent=True)
        return self._stop(profile().stops[how][-1].word, started_here=self._memory.runs)

    @needs_answer
    def reset(self) -> Exchange[None]:
        """Acknowledge a fault with a rising edge of bit 7; do nothing for a drive without a fault."""
        try:
            yield from self._commander().reset()
        except StateError as error:
            raise StateError(f"{error}; a fault can be acknowledged only 15 s after it occurred") from None

    @needs_answer
    def set_reference_percent(self, percent: ParameterValue | float) -> Exchange[None]:
        """Set the speed as a share of the maximum frequency, in 0.01 % steps; the reference frequency is set to zero.

        The value is written to RAM and has no sign: the motor keeps the direction in which it was started. The drive's
        reference is then read back. Raises StateError if it is another frequency.
        """
        return self._references.set_percent(percent)

    @needs_answer
    def set_reference_hz(self, hz: ParameterValue | float) -> Exchange[None]:
        """Set the speed as a frequency, in 0.01 Hz steps; the reference percentage is set to zero.

        Otherwise the same as `set_reference_percent`.
        """
        return self._references.set_hz(hz)

    @needs_answer
    def probe(self) -> Exchange[None]:
        """Read the state word once; a NAK proves a drive as well as a value does."""
        return self._talk.probe(STATE_WORD)

    @needs_answer
    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:  # noqa: ARG002 - one read returns everything
        """Read the state; no known manual names a parameter with the drive's type."""
        words = yield from unless_refused(self._talk.look())
        if words is None:
            return {}
        state = profile().state_of(words)
        return {"state": state.name if state else f"0x{words[profiles.SOLE_PLACE]:04X}"}

    def control_word(self, word: int) -> Exchange[None]:
        """Write the control word once, because a repeated edge or start could act twice."""
        return self._talk.command(word, attempts=1)

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Whether a call may start the motor: any control word but 0000, or a block, which can contain one.

        Unless parameter 412 is 1, the bits of any other word may be contacts.
        """
        if verb == "control_word":
            return arguments.get("word") != DISABLE_VOLTAGE
        if verb != "write":
            return False
        number = target(arguments["parameter"], self._model, "", None).number
        return number == BLOCK_TO_WRITE or (number == CONTROL_WORD and not _is_zero(arguments.get("value")))

    # Exchanges

    def _read_target(self, wanted: VabusTarget) -> Exchange[Reading]:
        reply = yield from self._talk.enquire(wanted.number, wanted.dataset or 0, wanted.address)
        return reading_of(wanted, reply.data, lower_case_hex=self._options.lower_case_hex)

    def _write_dataset(self, wanted: VabusTarget, *, store: bool) -> int:
        dataset = wanted.dataset or 0
        if dataset > 4:
            if store:
                raise UsageError(f"data set {dataset} is in RAM; to store, write data set {dataset - 5}")
            return dataset
        if store or wanted.number == CONTROL_WORD:
            return dataset
        check_store(wanted.address, "as asked" if self._options.ram_datasets else "always", store=store)
        return dataset + 5

    def _commander(self) -> Commander:
        return profiles.Commander(
            profile(),
            self._talk,
            state_timeout_s=self._options.state_timeout_s,
            advice="the hardware enable and parameter 412 (1 = state machine)",
            fault_code=self._fault_code,
        )

    def _fault_code(self) -> Exchange[int | None]:
        return unless_refused(self._talk.number(CURRENT_FAULT, "uint", "260, the current fault"), UnexpectedReplyError)

    def _start(self, *, reverse: bool) -> Exchange[None]:
        yield from self._commander().start(prepare=self._prepared(reverse=reverse))
        self._memory.runs = True

    def _prepared(self, *, reverse: bool) -> Exchange[None]:
        modes = (yield from self._talk.held(LOCAL_REMOTE, "uint", "412")).values()
        if set(modes) != {STATE_MACHINE}:
            listed = ", ".join(map(str, modes)) + (" in data sets 1 to 4" if len(modes) > 1 else "")
            raise StateError(
                f"parameter 412 (Local/Remote) is {listed or 'not known to the drive'}, but control words start "
                "the motor only if it is 1 (state machine) in every data set; with other values their bits may act as "
                "contacts; write 412 = 1"
            )
        yield from self._references.turn(backwards=reverse)

    def _stop(self, word: int, *, started_here: bool) -> Exchange[None]:
        """Stop by the state machine, or by 0000 unless the state machine is known to be in charge.

        412 is read once before any word but 0000. If an earlier request is still open, which would delay that, a word
        that cannot start a motor in any mode is sent first.
        """
        self._memory.runs = False
        safe = word if started_here else DISABLE_VOLTAGE
        if self._memory.maybe_locked:
            yield self._talk.tell(safe)
        if word != DISABLE_VOLTAGE:
            try:
                in_charge = yield from without_repeats(self._state_machine_in_charge())
            except ReplyError as error:
                if error.others_wait:
                    # The drive may hear without being heard. Its answer is requested after the other drives' turn.
                    yield self._talk.tell(safe)
                    raise
                # The next exchange begins with a read, so a late answer cannot confirm anything else,
                # and another stop of this drive need not wait for it.
                yield from self._talk.command(safe, nameless=False)
                return
            word = word if in_charge else DISABLE_VOLTAGE
        yield from self._talk.command(word, urgent=True)

    def _state_machine_in_charge(self) -> Exchange[bool]:
        try:
            modes = yield from self._talk.held(LOCAL_REMOTE, "uint", "412")
        except RefusedError:
            return False
        return set(modes.values()) == {STATE_MACHINE}


def _is_zero(value: object) -> bool:
    """Whether a value, given as a number or as text, is certainly 0."""
    try:
        return Decimal(str(value)) == 0
    except ArithmeticError:
        return False
