"""User at the other end of a local socket, checked at both ends of each of our connections.

Orders are accepted from this user and from root, who controls this user's programs anyway. Responses are trusted from
these two, and from the user of the system service, whose folder only root can have created.
"""

from __future__ import annotations

import os
import socket
import struct

from drivecomm.client.runtime_folders import ROOT, trusted_users

# macOS and FreeBSD, <sys/un.h> and unix(4): a struct xucred, which begins with its version and the user.
_SOL_LOCAL = 0
_LOCAL_PEERCRED = getattr(socket, "LOCAL_PEERCRED", None)
_XUCRED = 76
_UCRED = struct.Struct("3i")


def user_of_peer(connected: socket.socket) -> int | None:
    """Return the user ID at the other end of a socket.

    On systems that do not report it, return this user's, whose folder contains the socket. None if the other end has
    closed, or if the socket is not a Unix socket.
    """
    try:
        if hasattr(socket, "SO_PEERCRED"):
            found = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
            user = int(_UCRED.unpack(found)[1])
            # Linux also answers for a TCP connection, with an invalid user.
            return user if user >= 0 else None
        if _LOCAL_PEERCRED is not None:
            return int(struct.unpack_from("2I", connected.getsockopt(_SOL_LOCAL, _LOCAL_PEERCRED, _XUCRED))[1])
    except OSError:
        return None
    return os.getuid()


def may_command(connected: socket.socket) -> bool:
    """Return whether the other end is this user or root, whose requests are carried out."""
    return user_of_peer(connected) in (ROOT, os.getuid())


def check_peer(connected: socket.socket, place: str) -> None:
    """Raise PermissionError unless the program that listens at this place belongs to a trusted user."""
    user = user_of_peer(connected)
    if user not in trusted_users():
        who = "is unknown" if user is None else f"is user {user}"
        raise PermissionError(
            f"the program that listens at {place} {who}, neither this user nor root, and is not trusted"
        )
