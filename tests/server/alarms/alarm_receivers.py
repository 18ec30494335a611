"""A webhook receiver that can be made to misbehave."""

import json
import socket
import struct
import threading


class Hook:
    """HTTP server that receives webhooks.

    does: the HTTP status to answer with, or a misbehaviour: "hang", "drip" or "reset". got: received messages. begun:
    number of requests so far.
    """

    def __init__(self):
        self.does = 200
        self.got = []
        self.begun = 0
        self.headers = ""
        self._closed = threading.Event()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}/hook?token=secret"

    @property
    def told(self):
        """Events of all received alarms, such as "raised", in order of arrival."""
        return [each["what"] for message in self.got for each in message["alarms"]]

    def __enter__(self):
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_):
        self._closed.set()
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()

    def _accept(self):
        while not self._closed.is_set():
            try:
                connection, _ = self._listening.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=[connection], daemon=True).start()

    def _serve(self, connection):
        self.begun += 1
        with connection:
            if self.does == "hang":
                self._closed.wait()
            elif self.does == "drip":
                try:
                    while not self._closed.wait(0.05):
                        connection.sendall(b"H")
                except OSError:
                    pass
            elif self.does == "reset":
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            else:
                self._answer(connection)

    def _answer(self, connection):
        with connection.makefile("rb") as stream:
            lines = list(iter(stream.readline, b"\r\n"))
            self.headers = b"".join(lines).decode()
            length = next(int(line.split(b":")[1]) for line in lines if line.lower().startswith(b"content-length"))
            message = json.loads(stream.read(length))
        if self.does == 200:
            self.got.append(message)
        connection.sendall(b"HTTP/1.1 %d What\r\nContent-Length: 0\r\n\r\n" % self.does)
