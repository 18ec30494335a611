"""Keeping a terminal to oneself, so that no two programs take each other's bytes.

The lock (flock) keeps out those that look at it: drivecomm, and pyserial where it is told to be exclusive. The kernel's
own mark (TIOCEXCL) keeps out every program that opens the port afterwards, but for one that administrates the machine.
A pseudo-terminal has the lock only: the mark lasts there as long as the pair of terminals does, so that a program that
is killed would leave its line to nobody, not even to somebody who wants to stop a motor.
"""

from __future__ import annotations

import contextlib
import fcntl
import termios

from drivecomm.transport.port_names import is_pseudo


def lock(descriptor: int) -> None:
    """Lock an open terminal until it is closed. Raises OSError when another program has."""
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def keep_others_out(descriptor: int) -> None:
    """Let no other program open the terminal, where the kernel can."""
    if not is_pseudo(descriptor):
        with contextlib.suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)


def let_others_in(descriptor: int) -> None:
    """Take that back; somebody else may have had the terminal open before, and would keep it marked."""
    with contextlib.suppress(OSError):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)
