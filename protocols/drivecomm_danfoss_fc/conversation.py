"""The telegrams to and from one drive.

Control word and reference are in every telegram. In those that read and write parameters they are zero, so that the
drive ignores them. A word without bit 10 may let the drive's control word timeout run out (specification, section
12.2), so the status is asked for in two telegrams while a command holds: one whose word is ignored, and if its reply
says that the drive does what it was commanded, one that repeats the command.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.errors import AddressError, RefusedError, UnexpectedReplyError
from drivecomm.profiles import ONLY, ProcessWords
from drivecomm.protocol import Ask, Exchange, Tell, kept
from drivecomm_danfoss_fc import words
from drivecomm_danfoss_fc.faultcodes import fault_text
from drivecomm_danfoss_fc.messages import (
    FORMAT_31,
    ParameterReply,
    ParameterRequest,
    ProcessRequest,
    TextReply,
    TextRequest,
)
from drivecomm_danfoss_fc.parameters import target

if TYPE_CHECKING:
    from drivecomm.profiles import CommandMemory, ControlProfile, Step, Words
    from drivecomm_danfoss_fc.options import DanfossFcOptions

BROADCAST = 0

_COMMANDS_NOTHING: dict[str, Any] = {"control_word": words.IGNORED, "reference": 0}

Answer: TypeAlias = ParameterReply | TextReply


class Conversation(ProcessWords):
    """Telegrams to and from the drive at one address, or to all drives."""

    keeps_start = True

    def __init__(self, address: int, options: DanfossFcOptions, memory: CommandMemory) -> None:
        super().__init__(memory)
        if options.address_format == FORMAT_31 and address > 31:
            raise AddressError(f"address {address} does not exist in address format 1-31; addresses are 1 to 31")
        self.broadcast = address == BROADCAST
        self.profidrive = options.profile == "profidrive"
        shown = options.control_word_parameter, options.reference_parameter
        self._shown_in = [target(each, None, options).pnu if each else None for each in shown]
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

    def block(self, word: int, reference: int) -> ProcessRequest:
        """Return the process block with these words."""
        return ProcessRequest(**self._head, control_word=word, reference=reference)

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words]:
        """Send a word of the profile. A motor that runs by a command from here is not stopped for the next one."""
        if step in self.profile.start[:-1] and self.runs and self.says("running"):
            return {ONLY: self.seen}
        return (yield from super().send(step, urgent=urgent))

    def shown_word(self) -> Exchange[int | None]:
        """Read the control word that the drive got last over this port."""
        return self._word_in(self._shown_in[0])

    def shown_reference(self) -> Exchange[int | None]:
        """Read the reference that it got last."""
        return self._word_in(self._shown_in[1])

    def parameter(self, ak: int, pnu: int, ind: int, pwe: int = 0, *, acts: bool = False) -> Exchange[Answer]:
        """Send a parameter block and return what answers it."""
        ask = (
            Ask(message=self._parameter_block(ak, pnu, ind, pwe), acts=True) if acts else self._kept_read(ak, pnu, ind)
        )
        answer: Answer = self.noticed((yield ask))
        return answer

    def tell_parameter(self, ak: int, pnu: int, ind: int, pwe: int) -> Exchange[None]:
        """Send a parameter block to all drives at once."""
        yield Tell(message=self._parameter_block(ak, pnu, ind, pwe))

    def text(self, pnu: int, ind: int, text: str) -> Exchange[Answer]:
        """Send a text block that writes a text and return what answers it."""
        request = TextRequest(**self._head, ak=15, pnu=pnu, ind=ind, text=text, **_COMMANDS_NOTHING)
        answer: Answer = self.noticed((yield Ask(message=request, acts=True)))
        return answer

    def _word_in(self, pnu: int | None) -> Exchange[int | None]:
        """Read a word that the drive shows in a parameter; None when it has no such parameter."""
        if pnu is None:
            return None
        reply = yield from self.parameter(1, pnu, 0)
        return reply.pwe & 0xFFFF if isinstance(reply, ParameterReply) and reply.ak in (1, 2) else None

    def _new_read(self, ak: int, pnu: int, ind: int) -> Ask:
        return Ask(message=self._parameter_block(ak, pnu, ind, 0))

    def _parameter_block(self, ak: int, pnu: int, ind: int, pwe: int) -> ParameterRequest:
        return ParameterRequest(**self._head, ak=ak, pnu=pnu, ind=ind, pwe=pwe, **_COMMANDS_NOTHING)


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
