"""Terminal sessions of a page, carried out by a test: commands, their output, and simulators in the background."""

import contextlib
import doctest
import io
import os
import re
import shlex
import socket

from forked import Forked

from drivecomm.cli import main

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
EXIT_CODE = re.compile(r"# exit code (\d+)")
# Pages show one fixed port; the test replaces it by a free port.
SHOWN = "127.0.0.1:4001"


def must_match(wanted, found, where):
    """Compare the text of a page with the real output; `...` matches anything, and white space is ignored."""
    checker = doctest.OutputChecker()
    example = doctest.Example("", wanted)
    same = checker.check_output(wanted, found, FLAGS)
    assert same, f"{where}\n{checker.output_difference(example, found, FLAGS)}"


def in_process(arguments):
    """Run a drivecomm command in this process; return its exit code and all its output."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        code = main(arguments)
    return code, output.getvalue()


class Console:
    """A terminal, and further ones in which simulators run.

    run: function that runs a drivecomm command. folders: additional folders of modules for simulators.
    """

    def __init__(self, run, folders=()):
        self._run = run
        self._folders = folders
        self._simulators = []
        with socket.create_server(("127.0.0.1", 0)) as door:
            self._own = f"127.0.0.1:{door.getsockname()[1]}"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for simulator in self._simulators:
            simulator.terminate()
        for simulator in self._simulators:
            code, output = simulator.end()
            assert code == 0, output

    def play(self, block):
        """Run the commands of a block one by one, and compare exit codes and output with the page."""
        for command, shown in _commands_of(block):
            code, output = self._carry_out(command)
            expected = EXIT_CODE.search(command)
            assert code == (int(expected[1]) if expected else 0), f"{block}: {command}\n{output}"
            if shown:
                must_match("\n".join(shown) + "\n", output, f"{block}: {command}")

    def _carry_out(self, command):
        words = [word.replace(SHOWN, self._own) for word in shlex.split(command, comments=True)]
        if words[0] == "export":
            name, _, value = words[1].partition("=")
            os.environ[name] = value
            return 0, ""
        assert words[0] == "drivecomm", f"not a command that this test can run: {command}"
        code, output = self.simulate(words[1:]) if words[1] == "simulate" else self._run(words[1:])
        return code, output.replace(self._own, SHOWN)

    def simulate(self, arguments):
        """Start a simulator that runs until the terminal is closed; return exit code 0 and its first line."""
        simulator = Forked(arguments, self._folders)
        self._simulators.append(simulator)
        return 0, simulator.line()


def _commands_of(block):
    command, shown = "", []
    for line in block.code.splitlines():
        if line.startswith("$ "):
            if command:
                yield command, shown
            command, shown = line[2:], []
        else:
            shown.append(line)
    if command:
        yield command, shown
