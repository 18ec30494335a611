"""Clients of the doors with JSON over TCP: HTTP, and the door of the page "Write a door"."""

import json
import socket
import threading
import time
from contextlib import suppress
from itertools import count
from types import MappingProxyType

from every_door import token_of
from fake_plant import Client as HttpClient

ANOTHER_TIME = {"session": "another run", "issued_s": 1.0, "valid_s": 2}
"""Session and times of a stale command; a stop with these fields is sent all the same."""
VERBS = {"start": ("start", {}), "reference": ("set_reference", {"percent": 20}), "reset": ("reset", {})}
NUMBERS = count(1)


class JsonHand:
    """Common part of the clients of doors that accept commands as JSON."""

    wrong = MappingProxyType(
        {
            "old": {"issued_s": lambda: time.time() - 10},
            "from the future": {"issued_s": lambda: time.time() + 10},
            "of an earlier run": {"session": "another run"},
            "without an id": {"id": None},
            "valid for too long": {"valid_s": 60},
        }
    )

    def __init__(self, hall):
        self.hall, self.key = hall, ""

    def content(self, verb, **changes):
        name, arguments = VERBS[verb]
        content = {
            "id": f"n{next(NUMBERS)}",
            "session": self.session,
            "issued_s": time.time(),
            "valid_s": 2,
            "arguments": arguments,
            **({"lease": self.key} if self.key else {}),
            **{key: each() if callable(each) else each for key, each in changes.items()},
        }
        return name, {key: each for key, each in content.items() if each is not None}

    def let_go(self):
        self.key = ""

    def close(self):
        """Close the connections."""


class HttpHand(JsonHand):
    kind = "http"

    def __init__(self, hall):
        super().__init__(hall)
        self.session = self.client("otto").get("/api/v1/plant").content["session"]

    def client(self, name):
        return HttpClient(self.hall.doors["http"], token_of(name) if name else "")

    def post(self, who, path, content):
        found = self.client(who).post(f"/api/v1/drives/{path}", **content)
        return found.content.get("outcome", "refused"), found.content

    def hold(self):
        _, content = self.post("otto", "pump/lease", {"seconds": 20})
        self.key = content.get("key", "")
        return bool(self.key)

    def give(self, verb, drive="pump", **changes):
        name, content = self.content(verb, **changes)
        return self.post("otto", f"{drive}/{name}", content)[0]

    def stop(self, drive="pump"):
        return self.post("vera", f"{drive}/stop", ANOTHER_TIME)[0]

    def stranger(self, verb):
        name, content = ("stop", {"id": "x"}) if verb == "stop" else self.content(verb)
        return self.post("", f"pump/{name}", content)[0]


class LinesHand(JsonHand):
    kind = "lines"
    wrong = MappingProxyType(
        {
            **JsonHand.wrong,
            "without a session": {"session": None},
            "without its time": {"issued_s": None},
            "with nonsense": {"valid_s": "soon"},
        }
    )

    def __init__(self, hall):
        super().__init__(hall)
        self.socket = socket.create_connection(("127.0.0.1", hall.doors["lines"].address.port), timeout=20)
        self.answers, self._lock = {}, threading.Condition()
        threading.Thread(target=self._hear, daemon=True).start()
        self.session = self.ask("hello", "otto")["result"]["session"]

    def _hear(self):
        with suppress(OSError, ValueError), self.socket.makefile("rb") as lines:
            for line in lines:
                with self._lock:
                    answer = json.loads(line)
                    self.answers.setdefault(answer["id"], []).append(answer)
                    self._lock.notify_all()

    def ask(self, verb, who, drive="pump", **content):
        token = {"token": token_of(who)} if who else {}
        one, before = content.get("id", ""), len(self.answers.get(content.get("id", ""), ()))
        line = {**token, "verb": verb, "drive": drive, **content}
        self.socket.sendall(json.dumps(line).encode() + b"\n")
        with self._lock:
            assert self._lock.wait_for(lambda: len(self.answers.get(one, ())) > before, 30)
            return self.answers[one][before]

    def hold(self):
        return self.ask("take_lease", "otto", **self.content("start")[1])["outcome"] == "done"

    def let_go(self):
        self.ask("end_lease", "otto", **self.content("start")[1])

    def give(self, verb, drive="pump", **changes):
        name, content = self.content(verb, **changes)
        return self.ask(name, "otto", drive, **content)["outcome"]

    def stop(self, drive="pump"):
        return self.ask("stop", "vera", drive, **ANOTHER_TIME)["outcome"]

    def stranger(self, verb):
        name, content = ("stop", {}) if verb == "stop" else self.content(verb)
        return self.ask(name, "", **content)["outcome"]

    def close(self):
        self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()
