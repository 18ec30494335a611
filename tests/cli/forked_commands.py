"""Command lines as processes of their own, forked from one process that has loaded all modules.

Run as a program, this module is that process. It reads jobs as JSON, one a line, and answers each with the exit code
(negative for a signal, as in `subprocess`) and the text on standard output and standard error.
"""

import contextlib
import gc
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import time

import drivecomm.cli.stop.command

# Modules that commands import only while they run.
import drivecomm.cli.stop.everything
import drivecomm.cli.stop.one_drive
import drivecomm.plant.files  # noqa: F401
from drivecomm.cli.app import app
from drivecomm.cli.entry import run
from drivecomm.protocol import installed
from drivecomm_command import main

PATIENCE_S = 30


class Commands:
    """Runner of command lines, each in a fork of one loaded process."""

    def __init__(self, folder):
        self._folder = str(folder)
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder
        )

    def __call__(self, *arguments, stdin="null", stdout="file", stderr="file", encoding="utf-8", signal_after_s=None):
        """Run a command line and return its exit code and output.

        stdout, stderr: file, gone (a pipe without a reader), full, or closed. stdin: null or closed.
        """
        job = {
            "arguments": arguments,
            "streams": [stdin, stdout, stderr],
            "encoding": encoding,
            "signal_after_s": signal_after_s,
        }
        self._process.stdin.write(json.dumps(job) + "\n")
        self._process.stdin.flush()
        return Done(*json.loads(self._process.stdout.readline()))

    def close(self):
        self._process.stdin.close()
        self._process.wait(PATIENCE_S)
        self._process.stdout.close()


class Done:
    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err


def _serve():
    # Forks inherit the default action for Ctrl-C, with which any process starts.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    list(installed.working())
    jobs, answers = os.fdopen(os.dup(0), "r"), os.fdopen(os.dup(1), "w")
    with contextlib.redirect_stdout(io.StringIO()):
        run(["encode", "vabus", "kind=enquiry", "address=1", "parameter=481", "--json"])
    for each in app.commands.values():
        for command in getattr(each, "commands", {"": each}).values():
            assert command.loaded
    # Exclude the loaded objects from the garbage collections of each fork.
    gc.freeze()
    for text in jobs:
        job = json.loads(text)
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            child = os.fork()
            if not child:
                jobs.close()
                _become(job, out, err)
            code = _end_of(child, job["signal_after_s"])
            said = []
            for file in (out, err):
                file.seek(0)
                said.append(file.read().decode("utf-8", errors="replace"))
        answers.write(json.dumps([code, *said]) + "\n")
        answers.flush()


def _end_of(child, signal_after_s):
    began = time.monotonic()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        passed_s = time.monotonic() - began
        if signal_after_s is not None and passed_s >= signal_after_s:
            os.kill(child, signal.SIGINT)
            signal_after_s = None
        if passed_s > PATIENCE_S:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.001)


def _become(job, *files):
    """Run the command line and exit, with descriptors and streams as a shell and the interpreter set them up."""
    modes = ("r", "w", "w")
    for descriptor, (way, mode, file) in enumerate(zip(job["streams"], modes, (None, *files), strict=True)):
        if way == "closed":
            os.close(descriptor)
        elif way == "gone":
            reader, writer = os.pipe()
            os.close(reader)
            os.dup2(writer, descriptor)
            os.close(writer)
        elif way == "file":
            os.dup2(file.fileno(), descriptor)
        else:
            place = os.open({"null": os.devnull, "full": "/dev/full"}[way], os.O_RDWR)
            os.dup2(place, descriptor)
            os.close(place)
        # New stream objects, so that text buffered by the parent is not written twice.
        stream = None if way == "closed" else os.fdopen(descriptor, mode, encoding=job["encoding"], closefd=False)
        name = ("stdin", "stdout", "stderr")[descriptor]
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)
    sys.argv = ["drivecomm", *job["arguments"]]
    sys.exit(main())


if __name__ == "__main__":
    _serve()
