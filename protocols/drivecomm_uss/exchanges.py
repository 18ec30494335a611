"""The verbs of a drive that speaks USS."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from decimal import ROUND_HALF_EVEN, Decimal
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, Literal

from drivecomm.errors import (
    CommandTooOldError,
    NotSupported,
    RefusedError,
    StateError,
    UnexpectedReplyError,
    ValueRefusedError,
)
from drivecomm.protocol import Ask, Capabilities, DriveStatus, Pause, Stop, Tell, exact
from drivecomm_uss import words
from drivecomm_uss.memory import UssMemory
from drivecomm_uss.messages import Reply, Request
from drivecomm_uss.options import VARIABLE
from drivecomm_uss.parameters import PAGE, raw_for, reading_of, target
from drivecomm_uss.replies import error_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Exchange, Model, Reading, Value
    from drivecomm_uss.options import UssOptions
    from drivecomm_uss.parameters import Target

BROADCAST = 32
_POLL_S = 0.05
_KEPT = 512
_RAM_TASKS = {(False, False): 2, (False, True): 3, (True, False): 7, (True, True): 8}
_OTHER_TASKS = {2: 14, 3: 13, 7: 12, 8: 11}
"""Tasks by array and double word, and those of the same kind that do the other thing with EEPROM."""
_PERCENT_PER_STEP = Decimal(100) / words.HUNDRED_PERCENT


class UssOperations:
    """The verbs of one drive, or of all drives at address 32.

    extra: `control_word(word)`, and `release()`: stop repeating the command.
    """

    def __init__(self, address: int, options: UssOptions, model: Model | None, memory: UssMemory | None = None) -> None:
        self._broadcast = address == BROADCAST
        self._options = options
        self._model = model
        self._memory = memory or UssMemory()
        self._request = lru_cache(_KEPT, typed=True)(partial(Request, address=address))

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """The verbs beyond those that every protocol has."""
        return {"control_word": self.control_word, "release": self.release}

    @property
    def capabilities(self) -> Capabilities:
        """What the drive can be asked to do; its settings and its series decide."""
        options = self._options
        return Capabilities(
            stops=frozenset(words.STOP_WORDS),
            reverse=options.reverse_bit >= 0,
            reference_percent=options.pzd_words > 1,
            reference_hz=options.pzd_words > 1 and options.hertz is not None,
            stored_writes=options.eeprom_tasks != "none",
            volatile_writes=True,
            broadcast=options.broadcast,
        )

    def read(
        self, parameter: str, *, type: str = "", index: int | None = None, parameter_set: int = 1
    ) -> Exchange[Reading]:
        """Read a parameter. type: U16, I16, U32, I32 or Float. index: of an array. parameter_set: of a NORD drive."""
        self._must_be_one_drive("read")
        wanted = self._target(parameter, type=type, index=index, parameter_set=parameter_set)
        return self._read(wanted)

    def write(
        self,
        parameter: str,
        value: Value | float,
        *,
        store: bool = False,
        type: str = "",
        index: int | None = None,
        parameter_set: int = 1,
    ) -> Exchange[Reading | None]:
        """Write a parameter, to RAM, or with store to EEPROM too; returns what the drive reports.

        type, index, parameter_set: as of `read`. EEPROM cells wear: never store in a cycle.
        """
        self._must_be_one_drive("write")
        wanted = self._target(parameter, type=type, index=index, parameter_set=parameter_set)
        kept = self._options.eeprom_tasks
        if store and kept == "none":
            raise NotSupported("the task tables of this series know no storing in EEPROM; write without store")
        raw = raw_for(wanted, value)
        task = _RAM_TASKS[wanted.index is not None, wanted.double]
        return self._write(wanted, task if store is (kept == "2-8") else _OTHER_TASKS[task], raw)

    def address_of(self, parameter: str, *, index: int | None = None, parameter_set: int = 1, **_: Any) -> str:
        """Return number and index of a parameter; the parameter set of a NORD drive, from 2 on, goes before."""
        wanted = self._target(parameter, index=index, parameter_set=parameter_set)
        return wanted.address if parameter_set == 1 else f"P{parameter_set}:{wanted.address}"

    def status(self) -> Exchange[DriveStatus]:
        """Read status word and actual value; where a telegram off time is on, what was commanded is repeated."""
        self._must_be_one_drive("status")
        self._must_have_words("status")
        return self._status()

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start the motor with 047E and 047F; the reference is the one that was set, or the one the drive shows."""
        self._must_be_one_drive("start")
        self._must_have_words("start")
        if reverse and self._options.reverse_bit < 0:
            raise NotSupported("no bit of this series' control word reverses")
        bit = self._options.reverse_bit if reverse else self._options.right_bit
        return self._start(words.RUN | (1 << bit if bit >= 0 else 0))

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop with OFF1 (ramp), OFF2 (coast) or OFF3 (quick)."""
        self._must_have_words("stop")
        if how not in words.STOP_WORDS:
            raise NotSupported(f"the control word cannot stop by {how.value}; it can by ramp, coast and quick")
        word = words.STOP_WORDS[how]
        return self._tell_all(word) if self._broadcast else self._stop(word)

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault with 047E, 04FE, 047E; a drive without one is left alone."""
        self._must_be_one_drive("reset")
        self._must_have_words("reset")
        return self._reset()

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the main setpoint, -200 % to 199.99 %, to the nearest step of 0.0061 %."""
        self._must_be_one_drive("set_reference")
        self._must_have_words("set_reference", 2)
        return self._set_reference(_steps(exact(percent, "reference")))

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the main setpoint as a frequency, by the frequency of 100 % that the options give."""
        self._must_be_one_drive("set_reference")
        self._must_have_words("set_reference", 2)
        if self._options.hertz is None:
            raise NotSupported(
                "the telegram carries a percentage; give the frequency of 100 % (P2000), such as "
                "reference_frequency_hz=50, to set a reference in Hz",
                says="reference_frequency_hz=50",
            )
        return self._set_reference(_steps(exact(hz, "reference") * 100 / self._options.hertz))

    def probe(self) -> Exchange[None]:
        """Ask once for a telegram back that the drive does not evaluate; where it knows none, for nothing (AK 0)."""
        self._must_be_one_drive("probe")
        return self._look_in_mirror() if self._options.mirror else self._nothing(self._ask({}, attempts=1))

    def identify(self) -> Exchange[Mapping[str, str]]:
        """Read those parameters of the model that say what the drive is."""
        self._must_be_one_drive("identify")
        return self._identify()

    def control_word(self, word: int) -> Exchange[None]:
        """Send this control word once, with the reference that is set."""
        self._must_be_one_drive("control_word")
        self._must_have_words("control_word")
        if type(word) is not int or word not in range(0x10000):
            raise ValueRefusedError(f"control word {word!r} does not exist; they are 0 to 65535")
        return self._nothing(self._command(word, attempts=1))

    def release(self) -> Exchange[None]:
        """Stop repeating the control word; sends nothing. Refused where the next telegram without it would trip."""
        if self._options.running_needs_control and words.lets_run(self._memory.word):
            raise NotSupported("this drive trips when it runs and the control word goes; stop it first")
        return self._release()

    # Conversations

    def _read(self, wanted: Target) -> Exchange[Reading]:
        reply = yield from self._task(wanted, 1 if wanted.index is None else 6)
        return _reading(wanted, reply)

    def _write(self, wanted: Target, task: int, raw: int) -> Exchange[Reading]:
        # A reply with another value can be a late one to an earlier task for the same parameter.
        for _ in range(2):
            reading = _reading(wanted, (yield from self._task(wanted, task, raw)))
            if reading.raw == raw:
                return reading
        raise UnexpectedReplyError(
            f"parameter {wanted.address}: the drive reports {reading.raw} where {raw} was written"
        )

    def _task(self, wanted: Target, ak: int, value: int | None = None) -> Exchange[Reply]:
        page, pnu = (None, wanted.number) if self._options.ind in ("nord", "plain") else divmod(wanted.number, PAGE)
        fields = {"ak": ak, "pnu": pnu, "page": page, "index": wanted.index or 0, "value": value}
        if self._options.ind == "nord":
            fields["parameter_set"] = wanted.parameter_set
        reply = yield from self._ask(fields, acts=value is not None)
        if reply.ak == 7:
            code = reply.error or 0
            raise RefusedError(wanted.address, code, error_text(code, self._options.error_family))
        if reply.ak == 8:
            raise StateError(f"parameter {wanted.address} cannot be changed: this port has no right to (P0927)")
        return reply

    def _ask(self, fields: dict[str, Any], *, acts: bool = False, attempts: int | None = None) -> Exchange[Reply]:
        """Send a task with process words that command nothing, or with those that hold where the drive needs them."""
        memory = self._memory
        held = (memory.word or memory.idle) if self._options.running_needs_control else 0
        ask = Ask(message=self._message(fields, held), acts=acts, attempts=attempts, nameless=not fields)
        try:
            reply: Reply = yield replace(ask, command=_command_of(held, repeated=True))
        except CommandTooOldError:
            memory.command(0)
            reply = yield replace(ask, message=self._message(fields, 0))
        memory.see(reply.status_word or 0)
        return reply

    def _command(self, word: int, *, attempts: int | None = None, repeated: bool = False) -> Exchange[Reply]:
        """Send a control word with the reference that is set."""
        reply: Reply = yield Ask(
            message=self._message({}, word),
            acts=True,
            attempts=attempts,
            nameless=True,
            urgent=not repeated and not words.lets_run(word),
            command=_command_of(word, repeated=repeated),
        )
        self._memory.see(reply.status_word or 0)
        return reply

    def _message(self, fields: dict[str, Any], word: int) -> Request:
        options = self._options
        more: dict[str, Any] = {} if fields or not options.pkw_words else {"ak": 0, "pnu": 0}
        if fields and not options.pkw_words:
            raise NotSupported("this drive's telegrams have no PKW area, so its parameters cannot be reached")
        if options.pzd_words:
            more["control_word"] = word
        if options.pzd_words > 1:
            more["reference"] = (self._memory.reference or 0) if words.has(word, words.VALID) else 0
        if options.pzd_words > 2:
            more["pzd"] = (0,) * (options.pzd_words - 2)
        return self._request(**fields, **more)

    def _status(self) -> Exchange[DriveStatus]:
        memory = self._memory
        reply = yield from self._ask({})
        running = words.has(reply.status_word or 0, words.ENABLED)
        if memory.watched and memory.word and (running or not words.lets_run(memory.word)):
            with suppress(CommandTooOldError):
                reply = yield from self._command(memory.word, repeated=True)
        word, actual = reply.status_word or 0, reply.actual
        hertz = self._options.hertz
        percent = None if actual is None else actual * _PERCENT_PER_STEP
        return DriveStatus(
            word=word,
            state=words.state_of(word),
            running=words.has(word, words.ENABLED),
            fault=words.has(word, words.FAULT),
            warning=words.has(word, words.WARNING),
            at_reference=words.has(word, words.AT_SETPOINT),
            reverse=actual < 0 if actual else None,
            remote=words.has(word, words.REMOTE),
            actual_percent=percent,
            actual_hz=None if percent is None or hertz is None else percent * hertz / 100,
            flags=tuple(name for bit, name in enumerate(words.FLAGS) if words.has(word, bit)),
        )

    def _start(self, word: int) -> Exchange[None]:
        memory = self._memory
        status = (yield from self._ask({})).status_word or 0
        if words.has(status, words.FAULT):
            raise StateError("the drive has a fault and cannot start; reset it first")
        ours = words.lets_run(memory.word)
        yield from self._take_over_reference()
        if not ours or not words.has(status, words.ENABLED):
            memory.command(words.READY)
            yield from self._until("become ready to switch on", lambda now: now & 0b1001001 == 1)
        yield from self._command(word, attempts=1)
        memory.command(word)

    def _take_over_reference(self) -> Exchange[None]:
        if self._memory.reference is not None or self._options.pzd_words < 2:
            return
        shown = self._options.reference_parameter
        try:
            reading = (yield from self._read(self._target(shown, type="U16"))) if shown else None
        except RefusedError:
            reading = None
        if reading is None:
            raise StateError(
                "no reference was set from here, and the drive does not show the one that it has from the bus, so it "
                "would start with 0; set the reference first, while the motor stands: 0 where it comes from elsewhere"
            )
        raw = int(reading.raw)
        self._memory.reference = raw - 0x10000 if raw >= 0x8000 else raw

    def _until(self, what: str, reached: Callable[[int], bool]) -> Exchange[None]:
        """Repeat 047E until a status shows what is waited for. Raises StateError."""
        waited = 0.0
        while True:
            # The first reply does not show the reaction to its own request.
            reply = yield from self._command(words.READY)
            if reached(reply.status_word or 0):
                return
            if waited >= self._options.state_timeout_s:
                raise StateError(f"the drive did not {what}; its status word is {reply.status_word:04X}")
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S

    def _stop(self, word: int) -> Exchange[None]:
        self._memory.command(word)
        yield from self._command(word)

    def _reset(self) -> Exchange[None]:
        status = (yield from self._ask({})).status_word or 0
        if not words.has(status, words.FAULT):
            return
        self._memory.command(words.READY)
        yield from self._command(words.READY)
        yield from self._command(words.ACKNOWLEDGE, attempts=1)
        yield from self._until("let its fault be acknowledged", lambda now: not words.has(now, words.FAULT))

    def _set_reference(self, steps: int) -> Exchange[None]:
        memory = self._memory
        running = words.has((yield from self._ask({})).status_word or 0, words.ENABLED)
        if running and not (memory.word or memory.idle):
            raise StateError("the motor runs by a command that this program did not give; start it from here first")
        if words.lets_run(memory.word) and not running:
            raise StateError("the motor was started and does not run any more; start it anew, or stop it first")
        before, memory.reference = memory.reference, steps
        word = memory.word or words.READY
        if not words.lets_run(word):
            memory.command(word)
        try:
            yield from self._command(word, repeated=True)
        except CommandTooOldError:
            memory.reference = before
            raise

    def _tell_all(self, word: int) -> Exchange[None]:
        """Send a control word to all drives; the enable array lets only the bits through that stop (Appendix 2-4)."""
        options = self._options
        more: dict[str, Any] = {"reference": 0} if options.pzd_words > 1 else {}
        more |= {"pzd": (0,) * (options.pzd_words - 2)} if options.pzd_words > 2 else {}
        enable = (3, ~word & 0b111, 0, 0) if options.pkw_words else None
        yield Tell(message=Request(broadcast=True, enable=enable, control_word=word, **more))

    def _identify(self) -> Exchange[Mapping[str, str]]:
        found = {}
        for name in ("drive_type", "software_version"):
            address = self._model.quantities.get(name) if self._model else None
            if address and self._options.pkw_words:
                with suppress(RefusedError):
                    found[name] = str((yield from self._read(self._target(address))).value)
        return found

    def _look_in_mirror(self) -> Exchange[None]:
        """Have a telegram of the drive's length sent back (A-11).

        The special telegram before it is one that no drive here answers (A-4). If it comes back, so would the other one
        from any address, by an adapter that echoes.
        """
        pkw, pzd = self._options.pkw_words, self._options.pzd_words
        nothing = bytes(2 * ((4 if pkw == VARIABLE else pkw) + pzd)).hex(" ").upper()
        yield Tell(message=self._request(special=True, data=""))
        yield Ask(message=self._request(mirror=True, data=nothing), attempts=1, mirrored=True)

    def _nothing(self, exchange: Exchange[Reply]) -> Exchange[None]:
        yield from exchange

    def _release(self) -> Exchange[None]:
        self._memory.command(0)
        yield from ()

    def _target(self, parameter: str, **given: Any) -> Target:
        return target(parameter, self._model, self._options, **given)

    def _must_be_one_drive(self, verb: str) -> None:
        if self._broadcast:
            raise NotSupported(f"{verb} needs an answer, and nobody answers a broadcast")

    def _must_have_words(self, verb: str, least: int = 1) -> None:
        options = self._options
        if options.pzd_words < least:
            raise NotSupported(f"{verb} needs {least} process data words, and this drive has {options.pzd_words}")
        if self._broadcast and (not options.broadcast or options.pkw_words not in (0, 4, VARIABLE)):
            raise NotSupported("these drives do not obey a broadcast; stop them one by one")


def _command_of(word: int, *, repeated: bool) -> Literal["", "new", "repeated"]:
    if not words.has(word, words.VALID):
        return ""
    return "repeated" if repeated and words.lets_run(word) else "new"


def _reading(wanted: Target, reply: Reply) -> Reading:
    if reply.value is None:
        raise UnexpectedReplyError(f"the drive answered parameter {wanted.address} with AK {reply.ak} and no value")
    return reading_of(wanted, reply.value, 32 if reply.ak in (2, 5) else 16)


def _steps(percent: Decimal) -> int:
    """Return the step of PZD2 that is nearest to a percentage. Raises ValueRefusedError beyond its range."""
    limit = 1000
    steps = (
        (percent / _PERCENT_PER_STEP).quantize(Decimal(1), ROUND_HALF_EVEN) if abs(percent) < limit else Decimal(2**15)
    )
    if not -(2**15) <= steps < 2**15:
        raise ValueRefusedError("a reference is -200 % to 199.99 % of the reference frequency")
    return int(steps)
