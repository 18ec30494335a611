"""Telegrams to one drive, or to all.

Control word and reference are in every telegram. In those that read and write parameters they are zero, so that the
drive ignores them. A word without bit 10 may let the drive's control word timeout run out (specification, section
12.2). While a command is in force, a status request therefore takes two telegrams: one whose word is ignored, and, if
its reply shows that the drive obeys the command, one that repeats the command.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import AddressError
from drivecomm_danfoss_fc.messages import FORMAT_31, ParameterRequest, ProcessRequest, TextRequest
from drivecomm_danfoss_fc.parameters import target

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Exchange
    from drivecomm_danfoss_fc.messages import Request
    from drivecomm_danfoss_fc.options import DanfossFcOptions

BROADCAST = 0


class Frames:
    """Telegrams to the drive at one address.

    ask: sends the drive a task for a parameter.
    """

    keeps_start, needs_words = True, False

    def __init__(self, address: int, options: DanfossFcOptions, ask: Callable[..., Exchange[Any]]) -> None:
        if options.address_format == FORMAT_31 and address > 31:
            raise AddressError(f"address {address} does not exist in address format 1-31; addresses are 1 to 31")
        shown = {"control_word": options.control_word_parameter, "reference": options.reference_parameter}
        self._shown_in = {word: target(each, None, options).pnu for word, each in shown.items() if each}
        self._ask = ask
        to_all, form = address == BROADCAST, options.address_format
        self._head: Any = {"address_format": form, "broadcast": to_all, "address": None if to_all else address}

    def block(self, word: int, reference: int, /, **task: Any) -> Request:
        """Return the process block with these words, or the parameter or text block that also carries this task."""
        kind = TextRequest if "text" in task else ParameterRequest if task else ProcessRequest
        return kind(**self._head, control_word=word, reference=reference, **task)

    def shown(self, word: str) -> Exchange[int | None]:
        """Read the word that the drive last received over this port; None if no parameter shows it."""
        if word not in self._shown_in:
            return None
        reply = yield from self._ask(ak=1, pnu=self._shown_in[word], ind=0)
        return reply.pwe & 0xFFFF if reply.ak in (1, 2) else None
