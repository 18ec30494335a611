"""Small server that answers like `drivecomm serve`, from an opened plant; for tests of its clients."""

import socketserver
import threading
import time
import traceback
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler
from urllib.parse import unquote

from drivecomm.bus import LineChoices, keep, port_opener
from drivecomm.client import (
    Registration,
    drive_options,
    error_content,
    json_text,
    local_socket,
    parsed,
    plain,
    register,
)
from drivecomm.commissioning.doctor import judge, measure, measured_content
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.plant import OpenPlant, read_plant
from drivecomm.protocol import Stop


class FakeServer:
    """Server of a plant on a unix socket.

    hang: stop answering, like a suspended process. takes_s: time that it takes to answer while it reports that it is
    alive. drops: number of connections to close without an answer.
    """

    def __init__(self, path):
        self.path = path
        self.traced = {line.name: [] for line in read_plant(path).lines}
        self.plants = {}
        self.opened = OpenPlant(read_plant(path), own_ports=True)
        self.events = []
        self.keeps = {}
        self.hang = threading.Event()
        self.requests = []
        self.takes_s = 0.0
        self.drops = 0
        self.leases = {}

    def bus(self, line):
        """Return the bus of a line; its trace goes to all subscribers."""
        if line not in self.plants:
            told = self.traced[line]
            self.plants[line] = OpenPlant(
                self.opened.plant, own_ports=True, trace=lambda event: [tell(event) for tell in list(told)]
            )
        return self.plants[line].bus(line)

    def drive(self, name, body):
        found = next((each for each in self.opened.plant.drives if each.name == name), None)
        if found is None:
            raise UsageError(f"there is no drive {name!r} in this plant")
        self.bus(found.line)
        if not body.get("options") and not body.get("arm"):
            return self.plants[found.line].drive(name)
        reached = self.opened.plant.line(found.line).reached(found)
        options = {**reached.options, **drive_options(body.get("options", {}))}
        return self.bus(found.line).drive(found.protocol, found.address, **options)

    def line_drive(self, line, who, body):
        protocol, _, address = who.partition(":")
        if address == "*":
            return self.bus(line).broadcast(protocol)
        return self.bus(line).drive(protocol, int(address), **drive_options(body.get("options", {})))

    def command(self, drive, verb, body):
        given = dict(body["arguments"])
        if given.get("silence_s") is not None:
            given["silence_s"] = float(given["silence_s"])
        try:
            result = getattr(drive, verb)(**given)
        except DriveCommError as error:
            return {"id": body["id"], "outcome": "failed", "result": None, "error": error_content(error)}
        return {"id": body["id"], "outcome": "done", "result": plain(result), "error": None}

    def stop_all(self, how, lines):
        kinds = {(each.line, each.protocol) for each in self.opened.plant.drives if not lines or each.line in lines}
        for line, protocol in sorted(kinds):
            everybody = self.bus(line).broadcast(protocol)
            if Stop(how) in everybody.capabilities.stops:
                everybody.stop(Stop(how))
                yield {"drive": f"{protocol}:*", "line": line, "outcome": "open", "error": None, "how": how}
        for each in self.opened.plant.drives:
            if lines and each.line not in lines:
                continue
            drive = self.drive(each.name, {})
            way = Stop(how) if Stop(how) in drive.capabilities.stops else Stop.RAMP
            answer = self.command(drive, "stop", {"id": "", "arguments": {"how": way.value}})
            yield {"drive": each.name, "line": each.line, "outcome": answer["outcome"], "error": answer["error"],
                   "how": way.value}  # fmt: skip

    def close(self):
        for plant in [self.opened, *self.plants.values()]:
            plant.close()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def address_string(self):
        return "local"

    def __getattr__(self, name):
        if name.startswith("do_"):
            return lambda: self._answer(self._body())
        raise AttributeError(name)

    def _body(self):
        length = int(self.headers.get("Content-Length") or 0)
        return parsed(self.rfile.read(length)) if length else {}

    def handle_one_request(self):
        # An interrupted client closes its connection before the answer.
        try:
            super().handle_one_request()
        except ConnectionError:
            self.close_connection = True

    def _answer(self, body):
        fake = self.server.fake
        while fake.hang.is_set():
            time.sleep(0.02)
        if self.path != "/healthz":
            fake.requests.append((self.command, self.path, body))
            time.sleep(fake.takes_s)
            if fake.drops:
                fake.drops -= 1
                self.close_connection = True
                return
        try:
            content = self._content(fake, [unquote(part) for part in self.path.split("/")[1:]], body)
        except DriveCommError as error:
            self._send(404, {"error": error_content(error)})
            return
        if content is not None:
            self._send(200, content)

    def _content(self, fake, path, body):
        match path:
            case ["healthz"]:
                return {}
            case ["api", "v1", "stop"]:
                return list(fake.stop_all(body["how"], body.get("lines")))
            case ["api", "v1", "drives"]:
                return [{"name": each.name, "drive": str(each), "line": each.line, "reachability": "answers",
                         "groups": list(each.groups)} for each in fake.opened.plant.drives]  # fmt: skip
            case ["api", "v1", "drives", name, "lease"]:
                fake.leases[name] = self.command if self.command != "DELETE" else None
                if self.command == "DELETE" and name in fake.keeps:
                    fake.keeps[name].set()
                return {"drive": name, "holder": "me (local)", "until_s": 0, "key": "k1"}
            case ["api", "v1", "drives", name, "keep"]:
                return fake_keep(fake, name, body)
            case ["api", "v1", "drives", name, "keep", "events"]:
                return self._stream(lambda tell: follow_keep(fake, tell))
            case ["api", "v1", "drives", name, verb]:
                drive = fake.drive(name, body)
                if verb == "stop" and name in fake.keeps:
                    fake.keeps[name].set()
                return fake.command(drive, verb, body)
            case ["api", "v1", "lines", line, "drives", who, verb]:
                return fake.command(fake.line_drive(line, who, body), verb, body)
            case ["api", "v1", "lines", line, "scan"]:
                return self._stream(lambda tell: scan(fake, line, body, tell))
            case ["api", "v1", "lines", line, "doctor"]:
                return self._stream(lambda tell: examine(fake, line, body, tell))
            case ["api", "v1", "lines", line, "statistics"]:
                return self._stream(lambda tell: count(fake, line, tell))
            case ["api", "v1", "lines", line, "trace"]:
                return self._stream(lambda tell: trace(fake, line, tell))
        raise UsageError(f"no such path: {self.path}")

    def _stream(self, work):
        self.send_response(200)
        self.send_header("Transfer-Encoding", "chunked")
        self.end_headers()

        def tell(content):
            data = (json_text(content) + "\n").encode()
            self.wfile.write(b"%x\r\n%s\r\n" % (len(data), data))
            self.wfile.flush()

        try:
            work(tell)
        except DriveCommError as error:
            tell({"error": error_content(error)})
        except OSError:
            self.close_connection = True
            return
        self.wfile.write(b"0\r\n\r\n")

    def _send(self, status, content):
        data = json_text(content).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)


def scan(fake, line, body, tell):
    choices = body.get("choices")
    options = drive_options(body.get("options") or {})
    given = None if choices is None else LineChoices(**{name: tuple(each) for name, each in choices.items()})
    for one in fake.bus(line).scan(
        body["only"], body["addresses"], choices=given, progress=lambda *it: tell({"progress": list(it)}), **options
    ):
        tell({"found": plain(one)})


def examine(fake, line, body, tell):
    """Examine the line as `doctor` does, with a port of the fake server's own after its bus has released the line."""
    fake.plants.pop(line).close() if line in fake.plants else None
    port = port_opener(fake.opened.plant.line(line).reached_at)()
    drives = [fake.opened.plant.line(line).reached(each) for each in fake.opened.plant.on_line(line)]
    only = body["only"]
    report = port.report()
    try:
        found = measure(port, only=only, addresses=body["addresses"],
                        expected=[each for each in drives if not only or each.protocol in only],
                        probes=body["probes"], search=body["search"],
                        **drive_options(body.get("options") or {}))  # fmt: skip
    finally:
        port.close()
    for one in judge(found, report):
        tell({"finding": plain(one)})
    tell({"measured": plain(measured_content(report, found))})


def count(fake, line, tell):
    for name, each in fake.bus(line).statistics.items():
        times = plain(each.reply_times)
        tell(
            {
                "drive": name,
                "counters": dict(each.counters),
                "reply_times": {**times, "shortest_s": times["shortest_s"] if each.reply_times.count else None},
            }
        )


def trace(fake, line, tell):
    fake.bus(line)
    events = []
    fake.traced[line].append(events.append)
    try:
        while True:
            while events:
                event = events.pop(0)
                tell({"time": event.time, "what": event.what, "drive": event.drive, "data": plain(event.data),
                      "detail": event.detail})  # fmt: skip
            time.sleep(0.005)
            if not fake.serving.is_set():
                return
    finally:
        fake.traced[line].clear()


def fake_keep(fake, name, body):
    drive = fake.drive(name, {"arm": True})
    over, begun = threading.Event(), threading.Event()
    fake.keeps[name] = over
    told = []
    fake.events.append(told)
    failed = []

    def status(found):
        if found.fault:
            fault = " ".join(str(part) for part in (found.fault_code, found.fault_text) if part)
            told.append(
                {
                    "done": "fault",
                    "text": f"has a fault{f' ({fault})' if fault else ''}",
                    "fault_code": found.fault_code,
                }
            )
            over.set()

    def work():
        try:
            with keep(
                drive,
                body["policy"],
                watchdog_s=body["watchdog_s"],
                on_status=status,
                on_failure=lambda error: told.append({"error": error_content(error)}),
            ) as kept:
                told.append({"done": "watchdog set", "text": f"watchdog: {kept.watchdog} without this program"})
                if body.get("percent") is not None or body.get("hz") is not None:
                    drive.set_reference(percent=body.get("percent"), hz=body.get("hz"))
                drive.start(reverse=bool(body.get("reverse")))
                told.append(
                    {
                        "done": "started",
                        "text": "started; Ctrl-C stops it and restores the watchdog",
                        "link_loss": body["policy"],
                        "watchdog_s": str(body["watchdog_s"]),
                    }
                )
                begun.set()
                kept.until(over)
            told.append({"done": "stop commanded", "text": "stop commanded; watchdog restored"})
        except DriveCommError as error:
            failed.append(error)
        finally:
            begun.set()
            told.append(None)

    threading.Thread(target=work, daemon=True).start()
    begun.wait(10)
    if failed:
        return {"id": "", "outcome": "failed", "result": None, "error": error_content(failed[0])}
    return {"id": "", "outcome": "done", "result": None, "error": None}


def follow_keep(fake, tell):
    told, place = fake.events[-1], 0
    while True:
        while place < len(told):
            if told[place] is None:
                return
            tell(told[place])
            place += 1
        time.sleep(0.01)
        if not fake.serving.is_set():
            return


class _Server(socketserver.ThreadingUnixStreamServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, *_):
        traceback.print_exc()


@contextmanager
def serving(path, **about):
    """Serve a plant file for the duration of the block, registered as a server."""
    fake = FakeServer(path)
    socket = local_socket(path)
    socket.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    plant = fake.opened.plant
    record = Registration(
        plant=str(path.resolve()), name=path.stem, socket=str(socket),
        lines={line.name: line.reached_at for line in plant.lines}, started_s=time.time(), **about,
    )  # fmt: skip
    fake.serving = threading.Event()
    fake.serving.set()
    server = _Server(str(socket), _Handler)
    server.fake = fake
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        with register(record):
            yield fake
    finally:
        fake.hang.clear()
        fake.serving.clear()
        server.shutdown()
        server.server_close()
        socket.unlink(missing_ok=True)
        fake.close()
