"""Common equipment of all measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from clients import PythonMaster
    from compiling import Programs
    from extent import Extent
    from lines import Instrument


@dataclass(frozen=True, slots=True, kw_only=True)
class Equipment:
    """Extent of the run, the emulated lines, the C programs, and a Python process as the master."""

    extent: Extent
    instrument: Instrument
    programs: Programs
    master: PythonMaster
