"""The telegrams to and from one drive.

Control word and reference are in every telegram. In those that read and write parameters they are zero, so that the
drive ignores them. A word without bit 10 may let the drive's control word timeout run out (specification, section
12.2), so the status is asked for in two telegrams while a command holds: one whose word is ignored, and if its reply
says that the drive does what it was commanded, one that repeats the command.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import AddressError, RefusedError, UnexpectedReplyError
from drivecomm.protocol import Ask, Exchange, Tell, kept
from drivecomm_danfoss_fc import words
from drivecomm_danfoss_fc.faultcodes import fault_text
from drivecomm_danfoss_fc.messages import (
    FORMAT_31,
    ParameterReply,
    ParameterRequest,
    ProcessReply,
    ProcessRequest,
    TextReply,
    TextRequest,
)

if TYPE_CHECKING:
    from drivecomm.profiles import ControlProfile
    from drivecomm_danfoss_fc.memory import DanfossFcMemory
    from drivecomm_danfoss_fc.messages import Reply
    from drivecomm_danfoss_fc.options import DanfossFcOptions

BROADCAST = 0

Answer: TypeAlias = ParameterReply | TextReply


class Conversation:
    """Telegrams to and from the drive at one address, or to all drives. memory: what it was commanded."""

    def __init__(self, address: int, options: DanfossFcOptions, memory: DanfossFcMemory) -> None:
        if options.address_format == FORMAT_31 and address > 31:
            raise AddressError(f"address {address} does not exist in address format 1-31; addresses are 1 to 31")
        self.broadcast = address == BROADCAST
        self.profidrive = options.profile == "profidrive"
        self.memory = memory
        self._address = None if self.broadcast else address
        self._kept_read = kept(self._new_read)
        self._format = options.address_format

    @property
    def profile(self) -> ControlProfile:
        """The control profile; read from its file by who commands a drive, and not by who reads a parameter."""
        return words.profile(profidrive=self.profidrive)

    @property
    def runs(self) -> bool:
        """Whether the word that was commanded lets the motor run."""
        return self.profile.lets_run(self.memory.word)

    def look(self, *, attempts: int | None = None) -> Exchange[ProcessReply]:
        """Ask for status word and actual value with a word that the drive ignores."""
        reply: ProcessReply = yield Ask(message=self._block(words.IGNORED), attempts=attempts, nameless=True)
        self._notice(reply)
        return reply

    def command(self, word: int, *, attempts: int | None = None) -> Exchange[ProcessReply]:
        """Send a control word that is commanded now, with the reference that is set."""
        return self._process(word, Ask(message=self._block(word), attempts=attempts, acts=True, command="new"))

    def amend(self, word: int, *, attempts: int | None = None) -> Exchange[ProcessReply]:
        """Send a control word that builds on the one that was commanded. Raises CommandTooOldError if that is old."""
        return self._process(word, Ask(message=self._block(word), attempts=attempts, acts=True, command="repeated"))

    def repeat(self) -> Exchange[ProcessReply]:
        """Send the word that was commanded once more. Raises CommandTooOldError if it is old."""
        word = self.memory.word
        return self._process(word, Ask(message=self._block(word), command="repeated"))

    def _process(self, word: int, ask: Ask) -> Exchange[ProcessReply]:
        """Send a process block to one drive and return its reply, which says nothing of what it answers."""
        runs, valid = self.profile.lets_run(word), words.has(word, words.VALID_BIT)
        urgent = ask.command == "new" and not runs
        # Whatever does not let the motor run may be sent at any age.
        command = ("new" if not runs else ask.command) if valid else ""
        reply: ProcessReply = yield replace(ask, nameless=True, urgent=urgent, command=command)
        self._notice(reply)
        return reply

    def _block(self, word: int) -> ProcessRequest:
        return ProcessRequest(
            address_format=self._format,
            address=self._address,
            control_word=word,
            reference=self.memory.reference if words.has(word, words.VALID_BIT) else 0,
        )

    def tell_all(self, word: int) -> Exchange[None]:
        """Send a control word to all drives at once."""
        yield Tell(
            message=ProcessRequest(
                address_format=self._format, broadcast=True, control_word=word, reference=self.memory.reference
            )
        )

    def parameter(
        self, ak: int, pnu: int, ind: int, pwe: int = 0, *, attempts: int | None = None, acts: bool = False
    ) -> Exchange[Answer]:
        """Send a parameter block and return what answers it."""
        if pwe or acts or attempts is not None:
            ask = Ask(message=self._parameter_block(ak, pnu, ind, pwe), attempts=attempts, acts=acts)
        else:
            ask = self._kept_read(ak, pnu, ind)
        reply: Answer = yield ask
        self._notice(reply)
        return reply

    def tell_parameter(self, ak: int, pnu: int, ind: int, pwe: int) -> Exchange[None]:
        """Send a parameter block to all drives at once."""
        yield Tell(message=self._parameter_block(ak, pnu, ind, pwe))

    def text(self, pnu: int, ind: int, text: str) -> Exchange[Answer]:
        """Send a text block that writes a text and return what answers it."""
        request = TextRequest(
            address_format=self._format,
            address=self._address,
            ak=15,
            pnu=pnu,
            ind=ind,
            text=text,
            control_word=words.IGNORED,
            reference=0,
        )
        reply: Answer = yield Ask(message=request, acts=True)
        self._notice(reply)
        return reply

    def shown_word(self, pnu: int) -> Exchange[int | None]:
        """Read a word that the drive shows in a parameter; None when it has no such parameter."""
        reply = yield from self.parameter(1, pnu, 0)
        return reply.pwe & 0xFFFF if isinstance(reply, ParameterReply) and reply.ak in (1, 2) else None

    def stop_word(self, word: int) -> int:
        """Return a stop word together with the functions that are switched on."""
        return word | self.memory.functions

    def _new_read(self, ak: int, pnu: int, ind: int) -> Ask:
        return Ask(message=self._parameter_block(ak, pnu, ind, 0))

    def _parameter_block(self, ak: int, pnu: int, ind: int, pwe: int) -> ParameterRequest:
        return ParameterRequest(
            address_format=self._format,
            broadcast=self.broadcast,
            address=self._address,
            ak=ak,
            pnu=pnu,
            ind=ind,
            pwe=pwe,
            control_word=words.IGNORED,
            reference=0,
        )

    def _notice(self, reply: Reply) -> None:
        self.memory.see(reply.status_word, profidrive=self.profidrive)


def answered(reply: Answer, expected: frozenset[int], parameter: str) -> None:
    """Make sure that a reply is one of the expected responses.

    Raises RefusedError for AK 7 with the fault code in PWE low, UnexpectedReplyError for AK 0 and for unlisted AKs.
    """
    if reply.ak in expected:
        return
    if reply.ak == 7 and isinstance(reply, ParameterReply):
        code = reply.pwe & 0xFFFF
        raise RefusedError(parameter, code, fault_text(code))
    if reply.ak == 0:
        raise UnexpectedReplyError(
            f'the drive answered parameter {parameter} with AK 0, "no response": it did not process the command'
        )
    raise UnexpectedReplyError(f"the drive answered parameter {parameter} with AK {reply.ak}, which answers nothing")
