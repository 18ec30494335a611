"""A program without free descriptors: new clients are disconnected, without a busy loop."""

import os
import select
import socket
from contextlib import ExitStack, closing, suppress

import pytest

from drivecomm.virtual.accepting import Accepting

resource = pytest.importorskip("resource", reason="limits of descriptors are POSIX")


@pytest.fixture
def exhausted():
    """Yield a function that uses up all descriptors until the end of the test."""
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


def test_new_client_is_disconnected_while_no_descriptor_is_free(exhausted):
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


def test_new_client_is_accepted_while_descriptors_are_free():
    accepting = Accepting()
    with closing(accepting), socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as newcomer:
        accepting.open()
        newcomer.connect(server.getsockname())
        with accepting.next(server) as accepted:
            accepted.sendall(b"x")
            assert newcomer.recv(1) == b"x"
