"""Which terminals are pseudo-terminals: they have no speed, no parity and no control lines."""

from __future__ import annotations

import os
import re
import sys

# Linux, Documentation/admin-guide/devices.txt: the far ends of pseudo-terminals.
_LINUX_MAJORS = range(136, 144)
_NAMES = re.compile(r"/dev/(pts/\d+|ttys\d+|tty[p-zP-T][0-9a-f])")


def is_pseudo(descriptor: int) -> bool:
    """Whether this open terminal is the far end of a pseudo-terminal."""
    if sys.platform == "linux":
        return os.major(os.fstat(descriptor).st_rdev) in _LINUX_MAJORS
    try:
        return _NAMES.fullmatch(os.ttyname(descriptor)) is not None
    except OSError:
        return False
