"""Random scripts over servers that are processes, with real signals, limits and sockets; judged as the others are.

    python tests/adversary/real_servers.py --seed 1 --scripts 60 --at-once 4
    python tests/adversary/real_servers.py --seed 1 --script 7

Simulator and servers are forked from this process, which has loaded all that they need.
"""

import argparse
import json
import os
import random
import resource
import shutil
import signal
import socket
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from clocked_lines import Seen
from command_lines import fork, load
from orders import FOREVER, Book, Start, Stop, Trouble
from server_bench import DRIVES, ROLES, TOKENS, plant_text
from server_campaign import gathered
from server_judge import AFTER_SILENCE_S, Judge

from drivecomm.errors import DriveCommError
from drivecomm.server import token_hash
from drivecomm.virtual import ControlClient

LATE_S = 3.0
_READY_S, _PATIENCE_S, _LOOK_S = 30.0, 20.0, 0.03
_DESCRIPTORS, _STRANGERS = 128, 160


class Asked:
    """A request that is on its way; what comes of it is noted when it comes."""

    def __init__(self, place, path, content, user, order, *, method="POST"):
        self.order, self._told, self.answer, self.over = order, b"", None, False
        body = json.dumps(content).encode()
        head = f"{method} /api/v1/{path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
        head += f"Authorization: Bearer {TOKENS[user]}\r\n" if user else ""
        self._until = time.monotonic() + _PATIENCE_S
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


class RealScript:
    """One script: a simulator and a server of its own, in the folder that is the working one."""

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
            return [*Judge(self.book, self.truth, time.monotonic(), late_s=LATE_S).failures()]
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
            asked = Asked(("127.0.0.1", self.http), "drives", {}, "vera", None, method="GET")
            while not asked.over:
                self.pass_time(_LOOK_S)
                asked.look()
            if isinstance(asked.answer, list) and all(each.get("reachability") != "asking" for each in asked.answer):
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
        hurt = self.book.troubles or self.book.deaths
        self.pass_time(AFTER_SILENCE_S + 4 if hurt else 6.0)

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
        self.leases.append(_Lease(self, self.drive(), self.chance.choice((1.0, 3.0, 6.0))))

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
        self.book.deaths.append([now, how, now])
        os.kill(self.server, number)
        while os.waitpid(self.server, os.WNOHANG)[0] == 0:
            self.pass_time(0.05)
            assert time.monotonic() < now + _READY_S, "the server does not end"
        self.server = None
        self.pass_time(self.chance.choice((0.0, 2.0)))
        self.serve()

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
        # The stop of somebody who is known, while they are there.
        self.pass_time(0.5)
        drive = self.drive()
        order = Stop(time.monotonic(), "local", drive)
        self.book.stops.append(order)
        self.ask(f"drives/{drive}/stop", {"id": os.urandom(4).hex()}, "", order)
        asked = self.pending[-1]
        while not asked.over:
            self.pass_time(0.05)
        if asked.answer is None:
            # It counts as given: a stop has to go out whatever strangers do.
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


class _Lease:
    """A commander by HTTP: takes a lease, starts, renews it for a while, and is gone."""

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


def _work(seed, numbers, folder, results):
    load()
    for number in numbers:
        place = folder / str(number)
        place.mkdir()
        os.chdir(place)
        os.environ.update(XDG_RUNTIME_DIR=str(place), XDG_STATE_HOME=str(place / "state"))
        failures, one = [], None
        try:
            one = RealScript(seed, number)
            failures = one.run()
        except Exception as error:  # noqa: BLE001 - told as a failure of the script
            failures = [f"the campaign itself: {type(error).__name__}: {error}"]
        story = [f"  {at:8.2f} {text}" for at, text in (one.story if one else ())]
        text = "\n".join([f"real script {number} of seed {seed}:", *story, *(f"  FAILED {each}" for each in failures)])
        results.write(json.dumps([bool(failures), text if failures else ""]) + "\n")
        results.flush()


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--scripts", type=int, default=60)
    words.add_argument("--seed", default="1")
    words.add_argument("--script", type=int, action="append")
    words.add_argument("--at-once", type=int, default=4)
    given = words.parse_args()
    numbers = given.script or list(range(given.scripts))
    folder = Path(tempfile.mkdtemp(prefix="dc"))
    began, done, failed, workers = time.monotonic(), 0, 0, []
    for first in range(min(given.at_once, len(numbers))):
        read, write = os.pipe()
        child = os.fork()
        if not child:
            os.close(read)
            with os.fdopen(write, "w") as results:
                _work(given.seed, numbers[first :: given.at_once], folder, results)
            os._exit(0)
        os.close(write)
        workers.append((child, os.fdopen(read, "rb", buffering=0)))
    for line in gathered(workers):
        wrong, text = json.loads(line)
        done, failed = done + 1, failed + wrong
        if text:
            print(text, flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    print(f"seed {given.seed}, {time.monotonic() - began:.0f} s: {done} scripts with real processes, {failed} failed")
    sys.exit(1 if failed or done != len(numbers) else 0)


if __name__ == "__main__":
    main()
