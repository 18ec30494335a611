"""The telegrams that carry tasks and control words to one drive."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported
from drivecomm.protocol import kept, unless_refused
from drivecomm_uss.messages import Request

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles import ControlProfile
    from drivecomm.protocol import Exchange, Reading
    from drivecomm_uss.options import UssOptions


def profile() -> ControlProfile:
    """Return the control profile; read from its file by who commands a drive, and not by who reads a parameter."""
    return profiles.control_profile("profidrive")


class Frames:
    """What goes to one drive. read: reads a parameter, as a word."""

    keeps_start = False

    def __init__(self, address: int, options: UssOptions, read: Callable[[str], Exchange[Reading]]) -> None:
        self.request = kept(partial(Request, address=address))
        self.needs_words = options.running_needs_control
        self._options = options
        self._read = read

    def block(self, word: int, reference: int, /, **task: Any) -> Request:
        """Return a telegram with these words and this task, or with none."""
        options = self._options
        if task and not options.pkw_words:
            raise NotSupported("this drive's telegrams have no PKW area, so its parameters cannot be reached")
        fields = task or ({"ak": 0, "pnu": 0} if options.pkw_words else {})
        return self.request(**fields, **options.process_words(control_word=word, reference=reference))

    def shown(self, word: str) -> Exchange[int | None]:
        """Read the reference that the drive has from the bus; it shows no control word."""
        address = self._options.reference_parameter if word == "reference" and self._options.pkw_words else ""
        reading = (yield from unless_refused(self._read(address))) if address else None
        return None if reading is None else int(reading.raw)
