"""The telegrams to and from one drive.

Control word and reference are in every telegram. In those that read and write parameters they are zero, so that the
drive ignores them. A word without bit 10 may let the drive's control word timeout run out (specification, section
12.2), so the status is asked for in two telegrams while a command holds: one whose word is ignored, and if its reply
says that the drive does what it was commanded, one that repeats the command.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeAlias

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

_COMMANDS_NOTHING: dict[str, Any] = {"control_word": words.IGNORED, "reference": 0}

Answer: TypeAlias = ParameterReply | TextReply


class Conversation:
    """Telegrams to and from the drive at one address, or to all drives. memory: what it was commanded."""

    def __init__(self, address: int, options: DanfossFcOptions, memory: DanfossFcMemory) -> None:
        if options.address_format == FORMAT_31 and address > 31:
            raise AddressError(f"address {address} does not exist in address format 1-31; addresses are 1 to 31")
        self.broadcast = address == BROADCAST
        self.profidrive = options.profile == "profidrive"
        self.memory = memory
        self._kept_read = kept(self._new_read)
        self._head: dict[str, Any] = {
            "address_format": options.address_format,
            "broadcast": self.broadcast,
            "address": None if self.broadcast else address,
        }

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

    def command(
        self, word: int, *, age: Literal["new", "repeated"] = "new", attempts: int | None = None, acts: bool = True
    ) -> Exchange[ProcessReply]:
        """Send a control word to one drive, with the reference that is set; its reply says nothing of what it answers.

        age: whether it builds on the word that was commanded. Raises CommandTooOldError if that is old.
        """
        runs, valid = self.profile.lets_run(word), words.has(word, words.VALID_BIT)
        reply: ProcessReply = yield Ask(
            message=self._block(word),
            attempts=attempts,
            acts=acts,
            nameless=True,
            urgent=age == "new" and not runs,
            # Whatever does not let the motor run may be sent at any age.
            command=("new" if not runs else age) if valid else "",
        )
        self._notice(reply)
        return reply

    def _block(self, word: int) -> ProcessRequest:
        reference = self.memory.reference if words.has(word, words.VALID_BIT) else 0
        return ProcessRequest(**self._head, control_word=word, reference=reference)

    def tell_all(self, word: int) -> Exchange[None]:
        """Send a control word to all drives at once."""
        yield Tell(message=self._block(word))

    def parameter(self, ak: int, pnu: int, ind: int, pwe: int = 0, *, acts: bool = False) -> Exchange[Answer]:
        """Send a parameter block and return what answers it."""
        ask = (
            Ask(message=self._parameter_block(ak, pnu, ind, pwe), acts=True) if acts else self._kept_read(ak, pnu, ind)
        )
        reply: Answer = yield ask
        self._notice(reply)
        return reply

    def tell_parameter(self, ak: int, pnu: int, ind: int, pwe: int) -> Exchange[None]:
        """Send a parameter block to all drives at once."""
        yield Tell(message=self._parameter_block(ak, pnu, ind, pwe))

    def text(self, pnu: int, ind: int, text: str) -> Exchange[Answer]:
        """Send a text block that writes a text and return what answers it."""
        request = TextRequest(**self._head, ak=15, pnu=pnu, ind=ind, text=text, **_COMMANDS_NOTHING)
        reply: Answer = yield Ask(message=request, acts=True)
        self._notice(reply)
        return reply

    def shown_word(self, pnu: int) -> Exchange[int | None]:
        """Read a word that the drive shows in a parameter; None when it has no such parameter."""
        reply = yield from self.parameter(1, pnu, 0)
        return reply.pwe & 0xFFFF if isinstance(reply, ParameterReply) and reply.ak in (1, 2) else None

    def _new_read(self, ak: int, pnu: int, ind: int) -> Ask:
        return Ask(message=self._parameter_block(ak, pnu, ind, 0))

    def _parameter_block(self, ak: int, pnu: int, ind: int, pwe: int) -> ParameterRequest:
        return ParameterRequest(**self._head, ak=ak, pnu=pnu, ind=ind, pwe=pwe, **_COMMANDS_NOTHING)

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
