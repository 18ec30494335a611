"""Random scripts over a simulator process and a server process, with real signals, limits and sockets."""

import os
import random
import resource
import signal
import socket
import time
from contextlib import suppress
from pathlib import Path

from clocked_lines import Seen
from command_lines import fork
from orders import FOREVER, Book, Start, Stop, Trouble
from real_clients import Asked, Lease
from server_bench import DRIVES, ROLES, TOKENS, plant_text
from server_judge import AFTER_SILENCE_S, QUIET, Judge

from drivecomm.errors import DriveCommError
from drivecomm.server import token_hash
from drivecomm.virtual import ControlClient

LATE_S = 3.0
_READY_S, _LOOK_S = 30.0, 0.03
_DESCRIPTORS, _STRANGERS = 128, 160


class RealScript:
    """One script with its own simulator and server, in the working folder."""

    def __init__(self, seed, number):
        self.chance = random.Random(f"real {seed}-{number}")
        self.book, self.truth = Book(), {drive: [] for drive in DRIVES}
        self.pending, self.leases, self.later, self.strangers, self.story = [], [], [], [], []
        self.server = None
        ports = [socket.create_server(("127.0.0.1", 0)) for _ in range(3)]
        self.http, *lines = (each.getsockname()[1] for each in ports)
        for each in ports:
            each.close()
        text = plant_text(doors=("http",), listen=f"127.0.0.1:{self.http}")
        for line, port in zip(("hall", "yard"), lines, strict=True):
            text = text.replace(
                f'port = "{line}"\nlisten = "tcp:127.0.0.1:0"',
                f'port = "socket://127.0.0.1:{port}"\nlisten = "tcp:127.0.0.1:{port}"',
            )
        self.text = text
        Path("plant.toml").write_text(text)
        users = Path("users.toml")
        users.write_text(
            "".join(
                f'[[user]]\nname = "{name}"\nrole = "{ROLES[name]}"\ntoken = "{token_hash(TOKENS[name])}"\n'
                for name in TOKENS
            )
        )
        users.chmod(0o600)

    def run(self):
        self.simulator = fork("simulate", "plant.toml", "--control", "unix:door")
        until = time.monotonic() + _READY_S
        while True:
            with suppress(DriveCommError):
                self.control = ControlClient("unix:door")
                break
            assert time.monotonic() < until, "the simulator does not begin"
            time.sleep(0.02)
        try:
            self.serve()
            for _ in range(self.chance.randrange(5, 13)):
                self.pass_time(self.chance.choice((0.0, 0.1, 0.5, 1.0, 2.0)))
                what = self.chance.choices(list(STEPS), list(STEPS.values()))[0]
                self.note(what)
                getattr(self, what)()
            self.mend()
            return [*self.judge().failures()]
        finally:
            for process in (self.server, self.simulator):
                if process is not None:
                    with suppress(ProcessLookupError):
                        os.kill(process, signal.SIGKILL)
                        os.waitpid(process, 0)
            for each in self.strangers:
                each.close()

    def note(self, text):
        self.story.append((time.monotonic(), text))

    def serve(self):
        self.server = fork("serve", "plant.toml")
        until = time.monotonic() + _READY_S
        while True:
            assert time.monotonic() < until, "the server does not begin"
            drives = self.answer_to("drives")
            if isinstance(drives, list) and all(each.get("reachability") != "asking" for each in drives):
                return
            self.pass_time(0.1)

    def pass_time(self, seconds):
        until = time.monotonic() + seconds
        while True:
            now = time.monotonic()
            for state in self.control.order("show")["drives"]:
                known = self.truth.get(state["name"], [])
                seen = Seen(now, state["running"], state["output_hz"], state["powered"], state["fault"])
                if not known or known[-1].running != seen.running:
                    known.append(seen)
            for each in list(self.pending):
                each.look()
                if each.over:
                    self.pending.remove(each)
            for lease in self.leases:
                lease.look(self)
            for each in [each for each in self.later if each[0] <= now]:
                self.later.remove(each)
                each[1]()
            if now >= until:
                return
            time.sleep(min(_LOOK_S, max(0.0, until - now)))

    def mend(self):
        while self.later:
            self.pass_time(0.2)
        for lease in self.leases:
            lease.ends = 0.0
        self.pass_time(max([0.0, *(each.until - time.monotonic() for each in self.book.troubles)]))
        until, quiet = time.monotonic() + AFTER_SILENCE_S + 4, 0
        while quiet < QUIET and time.monotonic() < until:
            self.pass_time(1.0)
            quiet = quiet + 1 if self.hears_all() and not self.judge().owes() else 0

    def judge(self):
        return Judge(self.book, self.truth, time.monotonic(), late_s=LATE_S)

    def hears_all(self):
        values = self.answer_to("values")
        good = (each for each in values or () if each["quality"] == "good")
        return {each["drive"] for each in good if each["name"] == "output_frequency"} == set(DRIVES)

    def answer_to(self, path):
        """Wait for the server's answer, and return it."""
        asked = Asked(("127.0.0.1", self.http), path, {}, "vera", None, method="GET")
        while not asked.over:
            self.pass_time(_LOOK_S)
            asked.look()
        return asked.answer

    def ask(self, path, content, user, order):
        self.pending.append(Asked(("127.0.0.1", self.http) if user else self.local(), path, content, user, order))

    def local(self):
        return next((str(each) for each in Path(os.environ["XDG_RUNTIME_DIR"]).rglob("*.sock")), "nowhere")

    def drive(self):
        return self.chance.choice(list(DRIVES))

    # Steps

    def start_here(self):
        drive = self.drive()
        order = Start(time.monotonic(), "local", drive, local=True)
        self.book.starts.append(order)
        self.ask(f"drives/{drive}/keep", {"id": os.urandom(4).hex(), "policy": "hold", "percent": 60}, "", order)

    def start_under_a_lease(self):
        self.leases.append(Lease(self, self.drive(), self.chance.choice((1.0, 3.0, 6.0))))

    def stop_by_http(self):
        drive = self.drive()
        order = Stop(time.monotonic(), "http", drive)
        self.book.stops.append(order)
        self.ask(f"drives/{drive}/stop", {"id": os.urandom(4).hex()}, "vera", order)

    def stop_all(self):
        order = Stop(time.monotonic(), "local", "")
        self.book.stops.append(order)
        self.ask("stop", {}, "", order)

    def stop_by_command(self):
        drive = self.drive()
        order = Stop(time.monotonic(), "command", drive)
        self.book.stops.append(order)
        process = fork("stop", drive, "--plant", "plant.toml")

        def look():
            gone, status = os.waitpid(process, os.WNOHANG)
            if gone:
                order.answered = time.monotonic()
                order.outcome = "done" if os.waitstatus_to_exitcode(status) == 0 else "failed"
            else:
                self.later.append((time.monotonic() + 0.05, look))

        look()

    def kill(self):
        self._dies(signal.SIGKILL, "killed")

    def term(self):
        self._dies(signal.SIGTERM, "told to end")

    def _dies(self, number, how):
        now = time.monotonic()
        death = [now, how, FOREVER]
        self.book.deaths.append(death)
        os.kill(self.server, number)
        while os.waitpid(self.server, os.WNOHANG)[0] == 0:
            self.pass_time(0.05)
            assert time.monotonic() < now + _READY_S, "the server does not end"
        self.server = None
        self.pass_time(self.chance.choice((0.0, 2.0)))
        self.serve()
        death[2] = time.monotonic()

    def stand_still(self):
        seconds, now = self.chance.choice((0.5, 3.0, 7.0)), time.monotonic()
        self.book.troubles += [
            Trouble(now, now + seconds, "server stopped", line=line, dead=True) for line in ("hall", "yard")
        ]
        os.kill(self.server, signal.SIGSTOP)
        self.pass_time(seconds)
        os.kill(self.server, signal.SIGCONT)

    def hang_up(self):
        file, how = Path("plant.toml"), self.chance.choice(("half", "away", "same"))
        if how == "half":
            file.write_text(self.text[: len(self.text) // 2] + "][")
        elif how == "away":
            file.unlink()
        os.kill(self.server, signal.SIGHUP)
        self.later.append((time.monotonic() + 1.5, lambda: file.write_text(self.text)))

    def lose_requests(self):
        line, seconds, now = (
            self.chance.choice(("hall", "yard")),
            self.chance.choice((1.0, 4.0, 10.0)),
            time.monotonic(),
        )
        at = next(each["time_s"] for each in self.control.order("show")["lines"] if each["name"] == line)
        self.control.order(
            "fault", text=f'line = "{line}"\nkind = "drop"\nof = "request"\nfrom_s = {at}\nuntil_s = {at + seconds}'
        )
        self.book.troubles.append(Trouble(now, now + seconds, "requests lost", line=line, dead=True))

    def fill_the_disk(self):
        self._limit(resource.RLIMIT_FSIZE, 0)

    def use_up_descriptors(self):
        resource.prlimit(self.server, resource.RLIMIT_NOFILE, (_DESCRIPTORS, _DESCRIPTORS))
        for _ in range(_STRANGERS):
            with suppress(OSError):
                stranger = socket.create_connection(("127.0.0.1", self.http), timeout=0.2)
                stranger.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
                self.strangers.append(stranger)
        # Meanwhile, a known local caller requests a stop.
        self.pass_time(0.5)
        drive = self.drive()
        order = Stop(time.monotonic(), "local", drive)
        self.book.stops.append(order)
        self.ask(f"drives/{drive}/stop", {"id": os.urandom(4).hex()}, "", order)
        asked = self.pending[-1]
        while not asked.over:
            self.pass_time(0.05)
        if asked.answer is None:
            # The stop must be sent whatever strangers do, so it counts as ordered even without an answer.
            order.answered, order.outcome = order.at, "open"
        for each in self.strangers:
            each.close()

    def _limit(self, which, to):
        server, before = self.server, resource.prlimit(self.server, which)
        resource.prlimit(server, which, (to, before[1]))

        def lift():
            with suppress(ProcessLookupError):
                resource.prlimit(server, which, before)

        self.later.append((time.monotonic() + 3.0, lift))


STEPS = {
    "start_here": 5, "start_under_a_lease": 5, "stop_by_http": 5, "stop_all": 2, "stop_by_command": 2, "kill": 1,
    "term": 1, "stand_still": 2, "hang_up": 1, "lose_requests": 3, "fill_the_disk": 1, "use_up_descriptors": 1,
}  # fmt: skip
