"""The telegrams to and from one drive.

Control word and reference are in every telegram. In those that read and write parameters they are zero, so that the
drive ignores them. A word without bit 10 may let the drive's control word timeout run out (specification, section
12.2), so the status is asked for in two telegrams while a command holds: one whose word is ignored, and if its reply
says that the drive does what it was commanded, one that repeats the command.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.errors import AddressError, RefusedError, UnexpectedReplyError
from drivecomm.profiles import ProcessWords
from drivecomm.protocol import Exchange, Tell, kept
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
    from drivecomm.profiles import CommandMemory
    from drivecomm_danfoss_fc.messages import Request
    from drivecomm_danfoss_fc.options import DanfossFcOptions

BROADCAST = 0

Answer: TypeAlias = ParameterReply | TextReply


class Conversation:
    """Telegrams to and from the drive at one address, or to all drives. words: what commands it by them."""

    keeps_start, needs_words = True, False

    def __init__(self, address: int, options: DanfossFcOptions, memory: CommandMemory) -> None:
        if options.address_format == FORMAT_31 and address > 31:
            raise AddressError(f"address {address} does not exist in address format 1-31; addresses are 1 to 31")
        self.broadcast = address == BROADCAST
        self.profidrive = options.profile == "profidrive"
        self.words = ProcessWords(partial(words.profile, profidrive=self.profidrive), self, memory)
        shown = {"control_word": options.control_word_parameter, "reference": options.reference_parameter}
        self._shown_in = {word: target(each, None, options).pnu for word, each in shown.items() if each}
        head: dict[str, Any] = {
            "address_format": options.address_format,
            "broadcast": self.broadcast,
            "address": None if self.broadcast else address,
        }
        self._block = kept(lambda block, **fields: block(**head, **fields))

    def block(self, word: int, reference: int, /, **task: Any) -> Request:
        """Return the process block with these words, or the parameter or text block with this task besides."""
        kind = TextRequest if "text" in task else ParameterRequest if task else ProcessRequest
        request: Request = self._block(kind, control_word=word, reference=reference, **task)
        return request

    def shown(self, word: str) -> Exchange[int | None]:
        """Read what the drive got last over this port in the parameter that shows it; None where it has none."""
        if word not in self._shown_in:
            return None
        reply = yield from self.parameter(1, self._shown_in[word], 0)
        return reply.pwe & 0xFFFF if isinstance(reply, ParameterReply) and reply.ak in (1, 2) else None

    def parameter(self, ak: int, pnu: int, ind: int, pwe: int = 0, *, acts: bool = False) -> Exchange[Answer]:
        """Send a parameter block and return what answers it."""
        return self.words.ask(acts=acts, ak=ak, pnu=pnu, ind=ind, pwe=pwe)

    def tell_parameter(self, ak: int, pnu: int, ind: int, pwe: int) -> Exchange[None]:
        """Send a parameter block to all drives at once."""
        yield Tell(message=self.block(0, 0, ak=ak, pnu=pnu, ind=ind, pwe=pwe))

    def text(self, pnu: int, ind: int, text: str) -> Exchange[Answer]:
        """Send a text block that writes a text and return what answers it."""
        return self.words.ask(acts=True, ak=15, pnu=pnu, ind=ind, text=text)


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
