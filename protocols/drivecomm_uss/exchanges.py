"""Verbs of a drive that speaks USS."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import (
    NotSupported,
    RefusedError,
    StateError,
    UnexpectedReplyError,
    ValueRefusedError,
)
from drivecomm.profiles import SOLE_PLACE, CommandMemory, ProcessWords
from drivecomm.protocol import (
    Ask,
    Capabilities,
    DriveStatus,
    Stop,
    Tell,
    check_store,
    exact,
    needs_answer,
    reference_limit_of,
)
from drivecomm_uss.conversation import UssFrames
from drivecomm_uss.messages import Request
from drivecomm_uss.options import VARIABLE
from drivecomm_uss.parameters import DOUBLE, raw_for, reading_of, target, words_of
from drivecomm_uss.tasks import error_text, profile, task_that_writes

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from decimal import Decimal

    from drivecomm.profiles import Commander
    from drivecomm.protocol import Exchange, Model, Reading, Value
    from drivecomm_uss.messages import Reply
    from drivecomm_uss.options import UssOptions
    from drivecomm_uss.parameters import UssTarget

BROADCAST = 32

_TO_ALL = {Stop.RAMP: 0x043E, Stop.COAST: 0x0404, Stop.QUICK: 0x042A}
"""Control words that stop all drives.

Danfoss drives with addresses 1 to 31 hear them too, and the words that stop a single USS drive have bits 3 to 6 set,
which start a motor in the FC profile.
"""


class UssOperations:
    """Verbs of one drive, or of all drives at address 32.

    extra: `control_word(word)`, and `release()`, which stops repeating the command.
    """

    def __init__(
        self, address: int, options: UssOptions, model: Model | None, memory: CommandMemory | None = None
    ) -> None:
        self.answers = address != BROADCAST
        self._options = options
        self._model = model
        self._target = partial(target, model=model, options=options)
        known = model.parameters.values() if model is not None and options.pkw_words else ()
        self._full_scale = next((info.address for info in known if info.extra.get("full_scale")), "")
        self._asked: Mapping[str, Any] = {}
        self._said: Reply | None = None
        self._frames = UssFrames(address, options, partial(self.read, type="U16"))
        self._talk = ProcessWords(profile, self._frames, memory or CommandMemory(), self._frames.answer)
        self.extra: Mapping[str, Callable[..., Exchange[Any]]] = {
            "control_word": self.control_word,
            "release": self.release,
        }

    @property
    def capabilities(self) -> Capabilities:
        """The abilities of the drive, which depend on its settings and its series."""
        options, limit = self._options, reference_limit_of(self._options.reference_limit)
        return Capabilities(
            stops=frozenset(profile().stops),
            reverse=options.reverse_bit >= 0,
            reference_percent=options.pzd_words > 1,
            reference_hz=options.pzd_words > 1 and (options.hertz is not None or bool(self._full_scale)),
            stored_writes=options.eeprom_tasks != "none",
            volatile_writes=True,
            broadcast=options.obeys_broadcasts,
            reference_limit=limit,
            reference_limit_hz=None if options.hertz is None else options.hertz * limit / 100,
        )

    @needs_answer
    def read(
        self, parameter: str, *, type: str = "", index: int | None = None, parameter_set: int = 1
    ) -> Exchange[Reading]:
        """Read a parameter.

        type: U16, I16, U32, I32 or Float. index: index of an array. parameter_set: parameter set of a NORD drive.
        """
        return self._read(self._target(parameter, type=type, index=index, parameter_set=parameter_set))

    @needs_answer
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
        """Write a parameter to RAM, with `store` also to EEPROM; return the value that the drive reports.

        type, index, parameter_set: as in `read`. EEPROM cells wear: never store in a cycle.
        """
        wanted = self._target(parameter, type=type, index=index, parameter_set=parameter_set)
        kept = self._options.eeprom_tasks
        check_store(wanted.address, "never" if kept == "none" else "as asked", store=store)
        if wanted.type in DOUBLE and self._options.pkw_words == 3:
            raise NotSupported(
                f"{wanted.address} has 32 bits, for which a PKW area of 3 words has no room; set drive and pkw_words "
                "to 4 or 127",
                says="pkw_words",
            )
        raw = raw_for(wanted, value)
        stored = store is (kept != "2-8")
        task = task_that_writes(array=wanted.index is not None, double=wanted.type in DOUBLE, stored=stored)
        return self._write(wanted, task, raw)

    def address_of(self, parameter: str, *, index: int | None = None, parameter_set: int = 1, **_: Any) -> str:
        """Return number and index of a parameter; set 2 and above of a NORD drive precede these."""
        wanted = self._target(parameter, index=index, parameter_set=parameter_set)
        return wanted.address if parameter_set == 1 else f"P{parameter_set}:{wanted.address}"

    @needs_answer
    def status(self) -> Exchange[DriveStatus]:
        """Read status word and actual value; this repeats the present command if a telegram off time is active."""
        self._must_have_words("status", 1)
        reply: Reply = yield from self._talk.status()
        actual, hertz = reply.actual, self._options.hertz
        percent = None if actual is None else profile().percent_of(actual)
        return profile().status(
            {SOLE_PLACE: reply.status_word or 0},
            reverse=actual < 0 if actual else None,
            actual_percent=percent,
            actual_hz=None if percent is None or hertz is None else percent * hertz / 100,
        )

    @needs_answer
    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start the motor with the reference that was set here, or else with the one that the drive shows."""
        self._must_have_words("start", 1)
        if reverse and self._options.reverse_bit < 0:
            raise NotSupported("no bit of this series' control word reverses")
        taken_over = self._talk.take_over_reference() if self._options.pzd_words > 1 else None
        bit = self._options.reverse_bit if reverse else self._options.right_bit
        return self._commander(1 << bit if bit >= 0 else 0).start(prepare=taken_over)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop with OFF1 (ramp), OFF2 (coast) or OFF3 (quick)."""
        self._must_have_words("stop", 1)
        return self._commander().stop(how) if self.answers else self._tell_all(how)

    @needs_answer
    def reset(self) -> Exchange[None]:
        """Acknowledge a fault by one edge; do nothing for a drive without a fault."""
        self._must_have_words("reset", 1)
        return self._commander().reset()

    @needs_answer
    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the main setpoint as a percentage of P2000, rounded to steps of 0.0061 %."""
        self._must_have_words("set_reference", 2)
        return self._talk.set_reference(profile().steps_of(exact(percent, "reference")))

    @needs_answer
    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the main setpoint as a frequency.

        The frequency of 100 % comes from the options, or else from a parameter of the drive. In the latter case, a
        frequency above the reference_limit raises ValueRefusedError.
        """
        self._must_have_words("set_reference", 2)
        if self._options.hertz is None and not self._full_scale:
            raise NotSupported(
                "the telegram carries a percentage; give the frequency of 100 % (P2000), such as "
                "reference_frequency_hz=50, to set a reference in Hz",
                says="reference_frequency_hz=50",
            )
        return self._set_hz(exact(hz, "reference"))

    def _set_hz(self, hz: Decimal) -> Exchange[None]:
        full = self._options.hertz
        if full is None:
            found = yield from self.read(self._full_scale)
            full, limit = exact(found.value, "full scale"), self.capabilities.reference_limit
            if full <= 0:
                raise StateError(
                    f"100 % is {found} (parameter {found.parameter}), so no reference in Hz is a share of it"
                )
            if abs(hz) > full * limit / 100:
                raise ValueRefusedError(
                    f"a reference of {hz} Hz is above {limit} % of {found} (parameter {found.parameter})"
                )
        yield from self._talk.set_reference(profile().steps_of(hz * 100 / full))

    @needs_answer
    def probe(self) -> Exchange[None]:
        """Request a mirror telegram once, which the drive does not evaluate (A-11).

        Without mirror support, send an empty task. The special telegram before the mirror telegram is one that no drive
        here answers (A-4). If it comes back, an adapter echoes, and the mirror telegram would come back from any
        address.
        """
        pkw, pzd = self._options.pkw_words, self._options.pzd_words
        if not self._options.mirror:
            yield from self._talk.ask(attempts=1)
            return
        nothing = bytes(2 * ((4 if pkw == VARIABLE else pkw) + pzd)).hex(" ").upper()
        yield Tell(message=self._frames.request(special=True, data=""))
        yield Ask(message=self._frames.request(mirror=True, data=nothing), attempts=1, mirrored=True)

    @needs_answer
    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:
        """Read the parameters of the model that identify the drive."""
        found = {}
        for name in ("drive_type", "software_version"):
            address = self._model.quantities.get(name) if self._model else None
            if address and self._options.pkw_words and (not only or name in only):
                with suppress(RefusedError):
                    found[name] = str((yield from self._read(self._target(address))).value)
        return found

    @needs_answer
    def control_word(self, word: int) -> Exchange[None]:
        """Send this control word once, with the present reference."""
        self._must_have_words("control_word", 1)
        if type(word) is not int or word not in range(0x10000):
            raise ValueRefusedError(f"control word {word!r} does not exist; they are 0 to 65535")
        yield from self._talk.command(word, attempts=1, urgent=not profile().lets_run(word))

    def release(self) -> Exchange[None]:
        """Stop repeating the control word; sends nothing.

        Raises NotSupported if the next telegram without the control word would make the drive trip.
        """
        if self._options.running_needs_control and self._talk.runs:
            raise NotSupported("this drive trips if the control word stops while it runs; stop it first")
        return self._talk.release()

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Whether a call may start the motor: a control word that neither stops nor resets."""
        word = arguments.get("word")
        return verb == "control_word" and (not isinstance(word, int) or profile().may_start(word))

    # Exchanges

    def _read(self, wanted: UssTarget) -> Exchange[Reading]:
        return _reading(wanted, (yield from self._task(wanted, 1 if wanted.index is None else 6)))

    def _write(self, wanted: UssTarget, task: int, raw: int) -> Exchange[Reading]:
        # A reply with another value may answer an earlier task for the parameter; an empty task rules that out.
        for is_last in (False, False, True):
            if is_last:
                yield from self._talk.ask()
            reading = _reading(wanted, (yield from self._task(wanted, task, value=raw)))
            if reading.raw == raw:
                return reading
        raise UnexpectedReplyError(
            f"parameter {wanted.address}: the drive reports {reading.raw} where {raw} was written"
        )

    def _task(self, wanted: UssTarget, ak: int, **value: int) -> Exchange[Reply]:
        options = self._options
        words = words_of(value["value"], wanted.type, options) if value else None
        place = wanted.place_in(options)
        task, said = {"ak": ak, **place, **value}, self._said
        another = self._asked != task and {**self._asked, **place} == self._asked
        if another and (said is None or said.value is None or value.get("value") in (None, said.value)):
            # The reply to the previous task could match this one; an empty task (AK 0) in between rules that out.
            yield from self._talk.ask()
        self._asked, self._said = task, None
        reply: Reply = yield from self._talk.ask(acts=bool(value), pwe=words, **task)
        self._said = reply
        if reply.ak == 7:
            code = reply.error or 0
            raise RefusedError(wanted.address, code, error_text(code, options.error_family))
        if reply.ak == 8:
            raise StateError(f"parameter {wanted.address} cannot be changed: this port has no right to (P0927)")
        return reply

    def _commander(self, direction: int = 0) -> Commander:
        """Return the commander for the profile. direction: bits to add to each word that lets the motor run."""
        known = profile()
        start = tuple(replace(step, word=step.word | direction * known.lets_run(step.word)) for step in known.start)
        return self._talk.commander(replace(known, start=start), state_timeout_s=self._options.state_timeout_s)

    def _tell_all(self, how: Stop) -> Exchange[None]:
        """Send a control word to all drives; the enable array passes only the bits that stop (Appendix 2-4)."""
        options = self._options
        if how not in profile().stops:
            raise NotSupported(f"these drives cannot stop by {how.value}")
        word = _TO_ALL[how]
        enable = (3, ~word & 0b111, 0, 0) if options.pkw_words else None
        words = options.process_words(control_word=word, reference=0)
        yield Tell(message=Request(broadcast=True, enable=enable, **words))

    def _must_have_words(self, verb: str, least: int) -> None:
        options = self._options
        if options.pzd_words < least:
            raise NotSupported(f"{verb} needs {least} process data words, and this drive has {options.pzd_words}")
        if not self.answers and not options.obeys_broadcasts:
            raise NotSupported("these drives do not obey a broadcast; stop them one by one")


def _reading(wanted: UssTarget, reply: Reply) -> Reading:
    if reply.value is None:
        raise UnexpectedReplyError(f"the drive answered parameter {wanted.address} with AK {reply.ak} and no value")
    return reading_of(wanted, reply.value, 32 if reply.ak in (2, 5) else 16)
