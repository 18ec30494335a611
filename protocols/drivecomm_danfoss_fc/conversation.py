"""What a master remembers about one drive, and the telegrams that carry it.

Control word and reference are in every telegram. As long as nothing was commanded they are zero, so that the drive
ignores them; from the first command on they are repeated, because a word without bit 10 may let the drive's control
word timeout run out (specification, section 12.2).
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import AddressError, RefusedError, UnexpectedReplyError
from drivecomm.exchange import Ask, Exchange, Tell
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
    from drivecomm_danfoss_fc.messages import Reply
    from drivecomm_danfoss_fc.options import DanfossFcOptions

BROADCAST = 0

# Requests that are kept, to be sent again; more than a poll plan has.
_KEPT = 512

Answer: TypeAlias = ParameterReply | TextReply


class Conversation:
    """Telegrams to and from the drive at one address, or to all drives.

    word: the control word that is repeated, 0 before the first command. reference: PCD2 for it; reference_known: False
    until it was set here or taken over from the drive. functions: the bits for preset, ramp, relays and set-up that
    every command carries.
    """

    def __init__(self, address: int, options: DanfossFcOptions) -> None:
        if options.address_format == FORMAT_31 and address > 31:
            raise AddressError(f"address {address} does not exist in address format 1-31; addresses are 1 to 31")
        self.broadcast = address == BROADCAST
        self.profidrive = options.profile == "profidrive"
        self.word = words.IGNORED
        self.reference = 0
        self.reference_known = False
        self.functions = 0
        self._address = None if self.broadcast else address
        self._kept = lru_cache(_KEPT, typed=True)(self._new_read)
        self._kept_words = (words.IGNORED, 0)
        self._format = options.address_format

    @property
    def runs(self) -> bool:
        """Whether the word that is repeated lets the motor run."""
        return self._lets_run(self.word)

    def process(self, word: int, *, attempts: int | None = None, acts: bool = False) -> Exchange[ProcessReply]:
        """Send a process block to one drive and return its reply, which says nothing of what it answers."""
        valid = words.has(word, words.VALID_BIT)
        request = ProcessRequest(
            address_format=self._format,
            address=self._address,
            control_word=word,
            reference=self.reference if valid else 0,
        )
        reply: ProcessReply = yield Ask(
            message=request, attempts=attempts, acts=acts, nameless=True, urgent=acts and not self._lets_run(word)
        )
        self._notice(reply)
        return reply

    def tell_all(self, word: int) -> Exchange[None]:
        """Send a control word to all drives at once."""
        yield Tell(
            message=ProcessRequest(
                address_format=self._format, broadcast=True, control_word=word, reference=self.reference
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
        control_word, reference = self._process_words()
        request = TextRequest(
            address_format=self._format,
            address=self._address,
            ak=15,
            pnu=pnu,
            ind=ind,
            text=text,
            control_word=control_word,
            reference=reference,
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
        return word | self.functions

    def _kept_read(self, ak: int, pnu: int, ind: int) -> Ask:
        """Return a request that reads, the same object as before while the process words are the same."""
        words_now = self._process_words()
        if words_now != self._kept_words:
            self._kept_words = words_now
            self._kept.cache_clear()
        return self._kept(ak, pnu, ind)

    def _new_read(self, ak: int, pnu: int, ind: int) -> Ask:
        return Ask(message=self._parameter_block(ak, pnu, ind, 0))

    def _parameter_block(self, ak: int, pnu: int, ind: int, pwe: int) -> ParameterRequest:
        control_word, reference = self._process_words()
        return ParameterRequest(
            address_format=self._format,
            broadcast=self.broadcast,
            address=self._address,
            ak=ak,
            pnu=pnu,
            ind=ind,
            pwe=pwe,
            control_word=control_word,
            reference=reference,
        )

    def _process_words(self) -> tuple[int, int]:
        return (self.word, self.reference) if self.word else (words.IGNORED, 0)

    def _lets_run(self, word: int) -> bool:
        return words.lets_run(word, profidrive=self.profidrive)

    def _notice(self, reply: Reply) -> None:
        """Do not go on repeating a start to a drive that has tripped: whoever resets it would start the motor."""
        if self.runs and words.tripped(reply.status_word, profidrive=self.profidrive):
            self.word = self.stop_word(words.PROFIDRIVE_STANDSTILL if self.profidrive else words.RAMP_STOP)


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
