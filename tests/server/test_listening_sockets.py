"""Listening sockets of doors."""

import socket

import pytest

from drivecomm.errors import PortError
from drivecomm.server.listening import ListenAddress


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_accepted_connections_have_tcp_nodelay(host):
    try:
        opened = ListenAddress(host, 0).open()
    except PortError as error:
        pytest.skip(f"this machine has no {host}: {error}")
    with opened as listening, socket.create_connection(listening.getsockname()[:2]):
        connection, _ = listening.accept()
        with connection:
            assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
