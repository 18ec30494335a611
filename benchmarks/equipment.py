"""What every measurement needs."""

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
    """How much to measure, the emulated lines, the C programs, and a Python process to be the master."""

    extent: Extent
    instrument: Instrument
    programs: Programs
    master: PythonMaster
