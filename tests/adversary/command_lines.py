"""Command lines as processes with their own streams, limits and signals; nothing waits for their end."""

import contextlib
import faulthandler
import gc
import io
import os
import resource
import signal
import sys
import time
import traceback
from pathlib import Path

import drivecomm.cli.stop.command

# Load all modules that commands would load themselves.
import drivecomm.cli.stop.everything
import drivecomm.cli.stop.one_drive
import drivecomm.plant.files  # noqa: F401
from drivecomm.cli.app import app
from drivecomm.cli.entry import run
from drivecomm.protocol import installed
from drivecomm_command import main

_DESCRIPTORS = 200
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_AS_INSTALLED = "import sys; from drivecomm_command import main; sys.exit(main())"


def load():
    """Load all modules of commands, so that forked processes start quickly."""
    list(installed.working())
    for each in app.commands.values():
        for command in getattr(each, "commands", {"": each}).values():
            assert command.loaded
    with contextlib.redirect_stdout(io.StringIO()):
        run(["encode", "vabus", "kind=enquiry", "address=1", "parameter=481", "--json"])
        run(["models", "list"])
    gc.freeze()


def fork(*what, keep=()):
    """Start a function, or a command line without output, in a forked process; return its process number."""
    child = os.fork()
    if not child:
        try:
            os.setpgid(0, 0)
            for number in set(range(3, _DESCRIPTORS)) - set(keep):
                with contextlib.suppress(OSError):
                    os.close(number)
            if callable(what[0]):
                what[0]()
            else:
                _become(what, ("null", "null", "null"), spawned=False)
        except BaseException:  # noqa: BLE001 - this process must not return to the parent's code
            traceback.print_exc()
        finally:
            os._exit(1)
    return child


class CommandLine:
    """A running command line.

    stdout: file; gone (no reader); leaves (the reader closes early); full (disk); or closed. kind, drive: its meaning
    for the judge. after_s: signals with their times. largest: limit for the size of its files. spawned: start a new
    interpreter, which loads everything, as from a shell.
    """

    _count = 0

    def __init__(self, words, *, kind, drive="", stdout="file", signals=(), largest=None, spawned=False, **told):
        CommandLine._count += 1
        self.words, self.kind, self.drive, self.told = words, kind, drive, told
        self.stdout, self.largest, self.spawned = stdout, largest, spawned
        self._signals = sorted(signals)
        self.signalled = []
        self.name = f"{CommandLine._count:02d}-{kind}"
        self.out, self.err = Path(f"{self.name}.out"), Path(f"{self.name}.err")
        self.began = time.monotonic()
        self.ended = self.code = self.said_at = None
        files = (self.out.open("wb"), self.err.open("wb"))
        reader = self._reader = None
        where = [file.fileno() for file in files]
        if stdout == "leaves":
            reader, where[0] = os.pipe()
        # Block signals until the child is a command line, so that they arrive at its start and not before.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
        self._process = os.fork()
        if not self._process:
            self._turn_into(where)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for file in files:
            file.close()
        if reader is not None:
            os.close(where[0])
            os.set_blocking(reader, False)
            self._reader = reader

    def _turn_into(self, where):
        try:
            for number in set(range(3, _DESCRIPTORS)) - set(where):
                with contextlib.suppress(OSError):
                    os.close(number)
            if not self.spawned:
                # SIGUSR2 writes the stack traces of a hanging command.
                faulthandler.register(signal.SIGUSR2, file=open(f"{self.name}.hang", "w"))  # noqa: PTH123, SIM115
            if self.largest is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (self.largest, self.largest))
            out = self.stdout if self.stdout in {"gone", "full", "closed"} else where[0]
            _become(self.words, ("null", out, where[1]), spawned=self.spawned)
        except BaseException:  # noqa: BLE001 - this process must not return to the parent's code
            traceback.print_exc()
        finally:
            os._exit(99)

    @property
    def running(self):
        return self.ended is None

    def attend(self):
        """Send due signals, and check whether the process has ended."""
        if not self.running:
            return
        now = time.monotonic()
        if self.said_at is None and self.kind == "keep" and b"started" in self.out.read_bytes():
            self.said_at = now
        while self._signals and now - self.began >= self._signals[0][0]:
            self.signal(self._signals.pop(0)[1])
        if self._reader is not None and now - self.began > self.told.get("reads_s", 0):
            os.close(self._reader)
            self._reader = None
        ended, status = os.waitpid(self._process, os.WNOHANG)
        if ended:
            self.ended, self.code = time.monotonic(), os.waitstatus_to_exitcode(status)
            if self._reader is not None:
                os.close(self._reader)
                self._reader = None

    def signal(self, name):
        if self.running:
            self.signalled.append((time.monotonic(), name))
            os.kill(self._process, signal.Signals[name])

    def stack(self):
        """Return the stack traces of its threads."""
        if self.spawned:
            return ""
        os.kill(self._process, signal.SIGUSR2)
        time.sleep(0.5)
        return Path(f"{self.name}.hang").read_text()

    @property
    def killed(self):
        return self.code == -signal.SIGKILL and "SIGKILL" in {name for _, name in self.signalled}

    @property
    def complaint(self):
        return self.err.read_text(errors="replace")

    def told_of(self, since):
        """Return a line with the command and its outcome."""
        given = [
            word for word, said in (("new interpreter", self.spawned), (self.stdout, self.stdout != "file")) if said
        ]
        given += [f"files up to {self.largest}"] if self.largest is not None else []
        given += [f"{name} at {at - since:.2f}" for at, name in self.signalled]
        end = "runs" if self.running else f"{self.ended - since:.2f} exit {self.code}"
        more = f" [{', '.join(given)}]" if given else ""
        return f"  {self.began - since:5.2f}-{end}  drivecomm {' '.join(self.words)}{more}"


def _become(words, streams, *, spawned):
    for number in _ENDING:
        signal.signal(number, signal.SIG_DFL)
    for descriptor, way in enumerate(streams):
        if way == "closed":
            with contextlib.suppress(OSError):
                os.close(descriptor)
        elif way == "gone":
            reader, writer = os.pipe()
            os.close(reader)
            os.dup2(writer, descriptor)
            os.close(writer)
        elif isinstance(way, int):
            os.dup2(way, descriptor)
            os.close(way)
        else:
            place = os.open({"null": os.devnull, "full": "/dev/full"}[way], os.O_RDWR)
            os.dup2(place, descriptor)
            os.close(place)
    if spawned:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
        os.execv(sys.executable, [sys.executable, "-c", _AS_INSTALLED, *words])
    for descriptor, way in enumerate(streams):
        name = ("stdin", "stdout", "stderr")[descriptor]
        stream = None if way == "closed" else open(descriptor, "w" if descriptor else "r", closefd=False)  # noqa: SIM115
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)
    sys.argv = ["drivecomm", *words]
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
    try:
        code = main()
    except SystemExit as end:
        code = end.code
    try:
        # Flush the streams as an interpreter does at its end.
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except (OSError, ValueError):
        code = 120
    os._exit(code if isinstance(code, int) else 0)
