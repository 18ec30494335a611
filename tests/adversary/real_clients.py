"""Clients of a server process, whose requests are polled while others are in progress."""

import json
import os
import socket
import time
from contextlib import suppress

from orders import FOREVER, Start
from server_bench import DRIVES, PATIENCE_S, TOKENS


class Asked:
    """A request in progress; its outcome is recorded when it arrives."""

    def __init__(self, place, path, content, user, order, *, method="POST"):
        self.order, self._told, self.answer, self.over = order, b"", None, False
        body = json.dumps(content).encode()
        head = f"{method} /api/v1/{path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
        head += f"Authorization: Bearer {TOKENS[user]}\r\n" if user else ""
        self._until = time.monotonic() + PATIENCE_S
        self._socket = socket.socket(socket.AF_UNIX if isinstance(place, str) else socket.AF_INET)
        try:
            self._socket.settimeout(1.0)
            self._socket.connect(place)
            self._socket.sendall(head.encode() + b"\r\n" + body)
            self._socket.setblocking(False)
        except OSError:
            self._end()

    def look(self):
        if self.over:
            return
        try:
            data = self._socket.recv(65536)
        except BlockingIOError:
            if time.monotonic() > self._until:
                self._end()
            return
        except OSError:
            data = b""
        self._told += data
        if not data:
            with suppress(ValueError):
                self.answer = json.loads(self._told.partition(b"\r\n\r\n")[2])
            self._end()

    def _end(self):
        self.over = True
        self._socket.close()
        if self.order is not None and self.answer is not None:
            told = self.answer[0] if isinstance(self.answer, list) and self.answer else self.answer
            self.order.outcome = told.get("outcome", "refused") if isinstance(told, dict) else "open"
            self.order.answered = time.monotonic()


class Lease:
    """A commander by HTTP: acquires a lease, starts a motor, renews the lease for a while, and disappears."""

    SECONDS = 1.5

    def __init__(self, script, drive, there_s):
        now = time.monotonic()
        self.drive, self.ends, self.key = drive, now + there_s, ""
        self.order = Start(now, "http", drive, present_until=0.0)
        script.book.starts.append(self.order)
        self.asked, self.at, self.begun, self.hold = None, now, False, DRIVES[drive][3] == "hold"
        self._ask(script, f"drives/{drive}/lease", {"seconds": self.SECONDS}, None)

    def _ask(self, script, path, content, order, method="POST"):
        self.at = time.monotonic()
        self.asked = Asked(("127.0.0.1", script.http), path, content, "otto", order, method=method)

    def look(self, script):
        if self.asked is None:
            return
        self.asked.look()
        if not self.asked.over:
            return
        answer, now = self.asked.answer or {}, time.monotonic()
        if not self.key:
            self.key = answer.get("key", "") if isinstance(answer, dict) else ""
            if not self.key:
                self.order.outcome, self.order.answered, self.asked = "refused", now, None
                return
            self.order.present_until = FOREVER if self.hold else now + self.SECONDS
            content = {"id": os.urandom(4).hex(), "arguments": {"percent": 60}, "lease": self.key}
            self._ask(script, f"drives/{self.drive}/start", content, self.order)
            return
        if self.begun and "until_s" in answer and not self.hold:
            self.order.present_until = now + self.SECONDS
        self.begun = True
        if now > self.ends:
            self.asked = None
        elif now - self.at > self.SECONDS / 3:
            self._ask(script, f"drives/{self.drive}/lease", {"key": self.key, "seconds": self.SECONDS}, None, "PUT")
