"""A drivecomm command in a separate process, forked from one that has already imported the common modules.

Only modules are loaded beforehand; each process looks for protocols itself, like any other process.
"""

import multiprocessing
import os
import signal
import sys
from functools import cache
from multiprocessing import forkserver
from unittest import mock

from drivecomm_command import main

PATIENCE_S = 60


@cache
def _forks():
    forks = multiprocessing.get_context("forkserver")
    forks.set_forkserver_preload(["pytest", "preloaded", __name__])
    # The fork server imports modules before it gets our sys.path, so it needs PYTHONPATH.
    with mock.patch.dict(os.environ, PYTHONPATH=os.pathsep.join(path for path in sys.path if path)):
        forkserver.ensure_running()
    return forks


class Forked:
    """A running command. folders: additional folders of modules and packages, as in PYTHONPATH."""

    def __init__(self, arguments, folders=()):
        heard, said = _forks().Pipe(duplex=False)
        with said:
            self._process = _forks().Process(target=_become, args=(said, arguments, dict(os.environ), folders))
            self._process.start()
        with heard:
            self._output = os.fdopen(os.dup(heard.fileno()), encoding="utf-8")

    def line(self):
        return self._output.readline()

    def end(self):
        """Wait for the command to end; return its exit code and the rest of its output."""
        with self._output:
            rest = self._output.read()
        self._process.join(PATIENCE_S)
        code = self._process.exitcode
        self._process.close()
        return code, rest

    def terminate(self):
        self._process.terminate()


def _become(said, arguments, environment, folders):
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:0] = folders
    os.dup2(said.fileno(), 1)
    os.dup2(said.fileno(), 2)
    said.close()
    # The existing stream objects still refer to the old descriptors.
    sys.stdout, sys.stderr = os.fdopen(1, "w", encoding="utf-8"), os.fdopen(2, "w", encoding="utf-8", buffering=1)
    sys.argv = ["drivecomm", *arguments]
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    sys.exit(main())
