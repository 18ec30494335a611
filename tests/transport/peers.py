"""Other ends of a port, which send bytes and disconnect."""

import contextlib
import os
import socket
import struct
import tty


class Terminal:
    def __init__(self):
        self.ours, self.theirs = os.openpty()
        tty.setraw(self.theirs)
        self.url = os.ttyname(self.theirs)

    def send(self, data):
        os.write(self.ours, data)

    def end(self):
        os.close(self.ours)

    def close(self):
        for descriptor in (self.ours, self.theirs):
            # A test may have closed its side.
            with contextlib.suppress(OSError):
                os.close(descriptor)


class Server:
    def __init__(self):
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self._peer = None

    def send(self, data):
        if self._peer is None:
            self._peer, _ = self._server.accept()
            self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._peer.sendall(data)

    def end(self):
        self._peer.close()

    def close(self):
        if self._peer is not None:
            self._peer.close()
        self._server.close()


class CrashingServer(Server):
    def end(self):
        # Closing like this sends a reset instead of an orderly end.
        self._peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._peer.close()
