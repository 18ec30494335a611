"""A program without a descriptor left: newcomers are turned away, and nobody is kept busy by them."""

import os
import select
import socket
from contextlib import ExitStack, closing, suppress

import pytest

from drivecomm.virtual.accepting import Accepting

resource = pytest.importorskip("resource", reason="limits of descriptors are POSIX")


@pytest.fixture
def exhausted():
    """Leave no descriptor for the time of the block that is entered."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with ExitStack() as stack:

        def exhaust():
            highest = os.dup(0)
            os.close(highest)
            resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 8, hard))
            with suppress(OSError):
                while True:
                    stack.callback(os.close, os.dup(0))

        yield exhaust
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_newcomer_is_turned_away_while_no_descriptor_is_left(exhausted):
    accepting = Accepting()
    with closing(accepting), socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as newcomer:
        accepting.open()
        newcomer.connect(server.getsockname())
        exhausted()
        assert select.select([server], [], [], 5)[0], "somebody waits"
        assert accepting.next(server) is None
        assert select.select([server], [], [], 0)[0] == [], "and nobody waits any more"
        newcomer.settimeout(5)
        assert newcomer.recv(1) == b""


def test_a_newcomer_is_accepted_while_there_are_descriptors():
    accepting = Accepting()
    with closing(accepting), socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as newcomer:
        accepting.open()
        newcomer.connect(server.getsockname())
        with accepting.next(server) as accepted:
            accepted.sendall(b"x")
            assert newcomer.recv(1) == b"x"
