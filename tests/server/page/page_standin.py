"""A fake plant with the server's API, on which the page is tested without lines and drives."""

import asyncio
import contextlib
import itertools
import math
import threading
import time
from decimal import Decimal
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from drivecomm.client import json_text

PAGE = Path(__file__).parents[3] / "drivecomm" / "server" / "http" / "page"
CSP = {"Content-Security-Policy": "default-src 'self'", "X-Content-Type-Options": "nosniff"}
COMMANDS = ["start", "set_reference", "reset"]
UNITS = {"output_frequency": "Hz", "output_current": "A", "reference_percent": "%", "heat_sink_temperature": "degC"}
STATES = {"running": 0x0637, "ready": 0x0631, "not_ready": 0x0640, "stopping": 0x0617, "fault": 0x0608}


class Answered(Response):
    media_type = "application/json"

    def render(self, content):
        return json_text(content).encode()


class StandIn:
    """The fake plant, and the server that shows it on loopback; tests may call its methods from their own thread."""

    def __init__(self, drives=("pump", "fan", "mixer"), lines=("hall", "yard"), role="operate"):
        self.role = role
        self.session = "first"
        self.started_s = time.time()
        self.asked = []
        """Each command: drive, verb, body."""
        self.answer = None
        """What commands are answered instead of being carried out: an outcome, or a text for a refusal."""
        self.needs_token = ""
        self.leases = {}
        self.longest_lease_s = 30.0
        self.streams = 0
        self.events = []
        self.alarms = []
        self.drifts = {}
        self._numbers = itertools.count(1)
        self._port = 0
        self._queues = set()
        self._hanging = False
        self._lock = threading.RLock()
        self.lines = [
            {"name": name, "port": f"/dev/ttyUSB{n}", "up": True, "error": "", "polls": 0, "missed": 0}
            for n, name in enumerate(lines)
        ]
        self.drives = {name: self._drive(name, n) for n, name in enumerate(drives)}

    def _drive(self, name, number):
        drive = {
            "name": name,
            "drive": f"vabus:{number % 30 + 1}",
            "line": self.lines[number % len(self.lines)]["name"],
            "title": f"{name.capitalize()} no. {number + 1}",
            "model": "agile",
            "armed": True,
            "reachability": "answers",
            "state": "ready",
            "fault": "",
            "error": "",
            "answered_s": time.time(),
            "age_s": 0.1,
            "kept": "",
            "standing_stop": None,
            "drift": {"state": "as approved", "changed": 0, "since_s": None, "compared_s": time.time()},
            "reply_s": 0.0123,
            "counters": {"requests": 5210, "replies": 5204, "retries": 6, "timeouts": 5, "damaged": 1},
            "read": {},
        }
        for quantity, value in zip(UNITS, ("0.00", "0.0", "50.00", "31.5"), strict=True):
            drive["read"][quantity] = Decimal(value)
        return drive

    # Methods for tests.

    @property
    def url(self):
        return f"http://127.0.0.1:{self._port}/"

    def move(self, drive, name, text):
        with self._lock:
            self.drives[drive]["read"][name] = Decimal(text)
        self._publish("values", [self._value(drive, name)])

    def run(self, drive, hz="32.00"):
        self._state(drive, "running")
        self.move(drive, "output_frequency", hz)
        self.move(drive, "output_current", "4.2")

    def trip(self, drive, code, text):
        self.drives[drive].update(fault=f"{code} {text}", code=code)
        self._state(drive, "fault")
        self.move(drive, "output_frequency", "0.00")
        self.happened("fault", f"{code} {text}", drive)

    def recover(self, drive):
        self.drives[drive].update(fault="", reachability="answers", error="")
        self._state(drive, "ready")
        self.happened("fault over", "the fault is reset", drive)

    def silence(self, drive):
        with self._lock:
            self.drives[drive].update(
                reachability="silent", error="vabus:2 did not answer within 0.2 s", answered_s=time.time()
            )
        self._publish("values", [self._value(drive, name) for name in ["status", *UNITS]])
        self.happened("silent", "no answer", drive)

    def close_line(self, name, error):
        next(line for line in self.lines if line["name"] == name).update(up=False, error=error)
        self.happened("line", error, line=name)

    def lease(self, drive, holder, seconds=15.0):
        self.leases[drive] = {
            "holder": holder,
            "door": "http",
            "until_s": time.time() + seconds,
            "key": "other",
            "yours": False,
        }
        self.happened("lease", f"{holder} has control", drive, who=holder)

    def stop_stands(self, drive, text):
        self.drives[drive]["standing_stop"] = text and {"text": text}
        self.happened("stop", text or "the drive has confirmed its stop", drive)

    def drift(self, drive, *changes, **more):
        """Make parameters of a drive differ from its approved set.

        changes: address, name, unit, approved value, and present value.
        """
        now_s = time.time()
        keys = ("address", "name", "unit", "approved", "now", "since_s")
        made = [dict(zip(keys, (*each, now_s), strict=True)) for each in changes]
        state = {"state": "changed", "changed": len(changes), "since_s": now_s, "compared_s": now_s}
        self.drives[drive]["drift"] = {**state, **more}
        self.drifts[drive] = {
            "changes": made, "replaced": "", "restore": "", "not_comparable": [], "untold": [], "approved_by": "Anna",
            "approved_s": now_s, **state, **more,
        }  # fmt: skip
        self.happened("warning", "not set as approved", drive)

    def end_lease(self, drive):
        self.leases.pop(drive, None)
        self.happened("lease", "control is over", drive)

    def alarm(self, drive, text):
        self.alarms.append(
            {
                "id": str(len(self.alarms) + 1),
                "rule": "tripped",
                "drive": drive,
                "text": text,
                "since_s": time.time(),
                "times": 1,
                "over_s": None,
                "acknowledged_by": "",
            }
        )
        self.happened("alarm", text, drive)

    def happened(self, kind, text, drive="", line="", who=""):
        event = {
            "number": next(self._numbers),
            "time_s": time.time(),
            "kind": kind,
            "text": text,
            "drive": drive,
            "line": line,
            "who": who,
        }
        with self._lock:
            self.events.append(event)
        self._publish("events", [event])

    def hang(self):
        """Stop all responses and messages, like a suspended server or a pulled cable."""
        self._hanging = True

    def go_on(self):
        self._hanging = False

    def restart(self):
        """Restart as a new run of the server, on the same port."""
        self.stop()
        self.session += "'"
        self.leases.clear()
        self.start()

    def flood(self, per_second, seconds):
        """Change a number of values a second, over all drives, in batches every half second like the page's stream."""
        places = itertools.cycle(itertools.product(self.drives, UNITS))
        until, sent, began = time.monotonic() + seconds, 0, time.monotonic()
        while time.monotonic() < until:
            batch = []
            for _ in range(per_second // 2):
                drive, name = next(places)
                self.drives[drive]["read"][name] = Decimal(f"{20 + sent * 7 % 1003 / 50:.2f}")
                batch.append(self._value(drive, name))
                sent += 1
            self._publish("values", batch)
            time.sleep(max(0.0, began + sent / per_second - time.monotonic()))
        return sent

    # The server.

    def start(self):
        config = uvicorn.Config(
            self._app(),
            host="127.0.0.1",
            port=self._port,
            log_level="critical",
            lifespan="off",
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        until = time.monotonic() + 10
        while not self._server.started and time.monotonic() < until:
            time.sleep(0.01)
        self._port = self._server.servers[0].sockets[0].getsockname()[1]

    def _serve(self):
        self._loop = asyncio.new_event_loop()
        self._loop.run_until_complete(self._server.serve())
        self._loop.close()

    def stop(self):
        self._hanging = False
        self._server.should_exit = True
        for queue in list(self._queues):
            self._loop.call_soon_threadsafe(queue.put_nowait, None)
        self._thread.join(10)

    async def _let_go(self):
        while self._hanging:  # noqa: ASYNC110 - set by another thread
            await asyncio.sleep(0.02)

    def _publish(self, name, content):
        text = f"event: {name}\ndata: {json_text(content)}\n\n"
        for queue in list(self._queues):
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(queue.put_nowait, text)

    def _state(self, drive, state):
        with self._lock:
            self.drives[drive]["state"] = state
        self._publish("values", [self._value(drive, "status")])

    def _value(self, drive, name):
        known = self.drives[drive]
        silent = known["reachability"] != "answers"
        now = known["answered_s"] if silent else time.time()
        if name == "status":
            reading = {
                "parameter": "411",
                "value": known["state"],
                "raw": STATES[known["state"]],
                "unit": "",
                "name": name,
                "text": known["fault"],
            }
        else:
            reading = {
                "parameter": "210",
                "value": known["read"][name],
                "raw": 1,
                "unit": UNITS[name],
                "name": name,
                "text": "",
            }
        unit, factor = known.get("machine_unit", ""), known.get("factor")
        machine = {}
        if unit and UNITS.get(name) == "Hz":
            machine = {"machine_value": known["read"][name] * factor, "machine_unit": unit}
        return {
            **machine,
            "drive": drive,
            "name": name,
            "quality": "stale" if silent else "good",
            "cause": "no answer" if silent else "",
            "time_s": time.time(),
            "source_s": now,
            "age_s": time.time() - now,
            "reading": {**reading, "time_s": now, "note": "", "quality": "good"},
        }

    def _shown(self, name, caller):
        known = self.drives[name]
        lease = self.leases.get(name)
        state = known["state"]
        status = {
            "word": STATES[state],
            "state": state,
            "running": state == "running",
            "fault": state == "fault",
            "warning": False,
            "at_reference": state == "running",
            "reverse": False,
            "remote": True,
            "fault_code": known.get("code"),
            "fault_text": known["fault"],
            "actual_percent": None,
            "actual_hz": known["read"]["output_frequency"],
            "flags": ["enabled"],
        }
        verbs = {"nobody": [], "view": ["stop"] if self.needs_token else []}.get(caller, [*COMMANDS, "stop"])
        return {
            **{key: each for key, each in known.items() if key not in {"read", "code", "factor"}},
            "may": verbs if known["armed"] else [verb for verb in verbs if verb == "stop"],
            "status": None if known["reachability"] == "silent" else status,
            "lease": lease and {key: lease[key] for key in ("holder", "door", "until_s", "yours")},
            "values": [self._value(name, each) for each in ["status", *known["read"]]],
        }

    def _plant(self):
        return {
            "name": "Hall 2",
            "file": "hall2.toml",
            "session": self.session,
            "version": "1",
            "started_s": self.started_s,
            "time_s": time.time(),
            "you": {"name": "asha", "role": self.role, "door": "http"},
            "lines": self.lines,
            "drives": list(self.drives),
            "alarms": len(self.alarms),
        }

    def _app(self):
        routes = [
            Route("/", lambda _: FileResponse(PAGE / "index.html")),
            Route("/healthz", lambda _: Response("ok")),
            Route("/api/v1/plant", lambda _: Answered(self._plant())),
            Route("/api/v1/drives", lambda _: Answered([self._shown(name, self.role) for name in self.drives])),
            Route(
                "/api/v1/drives/{drive}", lambda request: Answered(self._shown(request.path_params["drive"], self.role))
            ),
            Route("/api/v1/drives/{drive}/drift", lambda request: Answered(self.drifts[request.path_params["drive"]])),
            Route("/api/v1/events", lambda _: Answered(self.events)),
            Route("/api/v1/alarms", lambda _: Answered(self.alarms)),
            Route("/api/v1/alarms/{id}/acknowledge", self._acknowledge, methods=["POST"]),
            Route("/api/v1/history", self._history),
            Route("/api/v1/history/events", self._past),
            Route("/api/v1/login", self._login, methods=["POST"]),
            Route("/api/v1/stream", self._stream),
            Route("/api/v1/stop", self._stop_all, methods=["POST"]),
            Route("/api/v1/drives/{drive}/lease", self._lease, methods=["POST", "PUT", "DELETE"]),
            Route("/api/v1/drives/{drive}/{verb}", self._command, methods=["POST"]),
            Mount("/page", StaticFiles(directory=PAGE)),
        ]
        return _Guard(Starlette(routes=routes), self)

    async def _login(self, request):
        body = await request.json()
        if body["password"] != "right":
            return Answered({"error": {"kind": "NotAllowedError", "text": "wrong name or password"}}, 401)
        return Answered({"token": "secret", "until_s": time.time() + 3600})

    async def _acknowledge(self, request):
        for alarm in self.alarms:
            if alarm["id"] == request.path_params["id"]:
                alarm["acknowledged_by"] = "asha"
        return Answered({})

    async def _history(self, request):
        start, end = float(request.query_params["from"]), float(request.query_params["to"])
        middle = {"output_frequency": 32, "output_current": 4.2, "reference_percent": 50}.get(
            request.query_params["name"], 40
        )
        step = (end - start) / 300
        swing = middle * 0.06
        points = [
            [start + n * step, middle + swing * math.sin(n / 25) + swing / 6 * math.sin(n * 1.7), "good"]
            for n in range(300)
        ]
        points[120:130] = [[start + n * step, None, "bad"] for n in range(120, 130)]
        return Answered({"points": points})

    async def _past(self, request):
        asked = request.query_params
        fits = [each for each in self.events if all(asked.get(key) in {None, each[key]} for key in ("drive", "kind"))]
        return Answered([each for each in fits if each["time_s"] < float(asked.get("to", "inf"))])

    async def _lease(self, request):
        name, body = request.path_params["drive"], await request.json()
        until = time.time() + min(body.get("seconds", 0), self.longest_lease_s)
        lease = self.leases.get(name)
        if request.method == "POST" and lease:
            return Answered({"error": {"kind": "LeaseError", "text": f"{lease['holder']} has control of {name}"}}, 409)
        if request.method != "POST" and (not lease or lease["key"] != body["key"]):
            return Answered({"error": {"kind": "LeaseError", "text": f"the lease of {name} is over"}}, 409)
        if request.method == "DELETE":
            self.end_lease(name)
            return Answered({})
        self.leases[name] = {"holder": "asha", "door": "http", "until_s": until, "key": f"key-{name}", "yours": True}
        if request.method == "POST":
            self.happened("lease", "asha has control", name, who="asha")
        return Answered({"drive": name, "holder": "asha", "until_s": until, "key": f"key-{name}"})

    async def _command(self, request):
        drive, verb, body = request.path_params["drive"], request.path_params["verb"], await request.json()
        self.asked.append((drive, verb, body))
        answer = self._carried_out(drive, verb, body)
        return Answered(answer, {"done": 200, "refused": 403, "failed": 502, "open": 504}[answer["outcome"]])

    async def _stop_all(self, request):
        self.asked.append(("", "stop", await request.json()))
        return Answered([{"drive": name, **self._carried_out(name, "stop", {}), "how": "ramp"} for name in self.drives])

    def _carried_out(self, drive, verb, body):
        answer = {"id": body.get("id", ""), "outcome": "done", "result": None, "error": None}
        if self.answer in {"open", "failed"}:
            return {
                **answer,
                "outcome": self.answer,
                "error": {"kind": "TimeoutError", "text": f"{drive} did not answer within 0.2 s"},
            }
        if self.answer:
            return {**answer, "outcome": "refused", "error": {"kind": "NotAllowedError", "text": self.answer}}
        if verb == "keep":
            self.run(drive)
        elif verb == "stop":
            self._state(drive, "ready")
            self.move(drive, "output_frequency", "0.00")
        elif verb == "reset":
            self.recover(drive)
        self.happened("command", verb, drive, who="asha (http)")
        return answer

    async def _stream(self, _):
        queue = asyncio.Queue()
        self._queues.add(queue)
        self.streams += 1

        async def lines():
            try:
                yield f"event: hello\ndata: {json_text(self._plant())}\n\n"
                while True:
                    text = await queue.get()
                    await self._let_go()
                    if text is None:
                        return
                    yield text
            finally:
                self._queues.discard(queue)

        return StreamingResponse(lines(), media_type="text/event-stream")


class _Guard:
    """Middleware with the security headers, the token check, and the simulated hanging."""

    def __init__(self, app, plant):
        self._app = app
        self._plant = plant

    async def __call__(self, scope, receive, send):
        await self._plant._let_go()
        path = scope["path"]
        needed = self._plant.needs_token
        given = dict(scope["headers"]).get(b"authorization", b"").decode()
        if needed and path.startswith("/api/") and path != "/api/v1/login" and given != f"Bearer {needed}":
            response = JSONResponse({"error": {"kind": "NotAllowedError", "text": "sign in first"}}, 401)
            await response(scope, receive, send)
            return

        async def sent(message):
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *((k.lower().encode(), v.encode()) for k, v in CSP.items())]
            await send(message)

        await self._app(scope, receive, sent)
