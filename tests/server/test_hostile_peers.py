"""A door whose peer floods, stalls or sends garbage: polls keep their times, and the other doors answer as before.

Measured on a server process, in the same run: with the peer, and with a peer that does the same to a bystander, which
takes as much of the machine.
"""

import http.client
import logging
import os
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from importlib.metadata import entry_points
from itertools import pairwise

import pytest
from hostile_peers import BROKERS, BYSTANDER, DOORS, PEERS
from processes import QUICK, serving

from drivecomm.server.history import History
from drivecomm.server.history.journal import COMMITTED_EVERY_S

pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(os.name != "posix", reason="peers are kept from the cores that are measured by nice"),
]

_LOG = logging.getLogger("measured")
"""Shown by --log-cli-level=info."""

MEASURED_S = 4.0
PERIOD_S = 0.1
LATER_S = {("http", "connects"): 0.25}
"""By how much polls may be later at worst, 0.05 s unless said: the HTTP door takes whatever connections come."""
RUNS = 3


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return taken.getsockname()[1]


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    known = {each.name for each in entry_points(group="drivecomm.doors")}
    ports = {kind: free_port() for kind in [*DOORS, "other"] if kind == "other" or kind in known}
    doors = [DOORS[kind].format(port=ports[kind]) for kind in DOORS if kind in ports]
    head = "".join([*doors, DOORS["http"].format(port=ports["other"]), QUICK])
    with serving(tmp_path_factory.mktemp("plant"), head=head) as one:
        one.until(lambda: one.drive("fan")["reachability"] == "answers")
        one.ports = ports
        yield one


class Seen:
    """What goes on for a while: when each poll was answered, by the history, and how long another door takes."""

    def __init__(self, served):
        self.waits_s = []
        self._history = next(served.folder.glob("state/**/history.sqlite"))
        self._began_s = time.time()
        end = time.monotonic() + MEASURED_S
        while time.monotonic() < end:
            began = time.monotonic()
            connection = http.client.HTTPConnection("127.0.0.1", served.ports["other"], timeout=30)
            connection.request("GET", "/api/v1/drives/fan")
            assert connection.getresponse().read()
            connection.close()
            self.waits_s.append(time.monotonic() - began)
            time.sleep(0.02)
        self._ended_s = time.time()

    def late_p95(self):
        """How much later than a period after the one before nineteen of twenty polls were answered at most."""
        with History(self._history) as history:
            found = list(history.values("fan", "output_frequency", self._began_s, self._ended_s))
        late = sorted((after.time_s - before.time_s) - PERIOD_S for before, after in pairwise(found))
        assert late, "the history has no values"
        return late[int(0.95 * len(late))]

    def wait_p95(self):
        """How long nineteen of twenty questions took at most."""
        return sorted(self.waits_s)[int(0.95 * len(self.waits_s))]


_LAST = ["nice", "-n", "19", sys.executable, "-c"]
"""Peers are at the end of the queue for the processor, so that it is not the processor which they take that is seen."""


@pytest.fixture(scope="module")
def bystander():
    """The port of somebody to whom a peer may do what it does to doors."""
    with subprocess.Popen([*_LAST, BYSTANDER], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield int(process.stdout.readline())
        finally:
            process.kill()


@contextmanager
def peer(program, port):
    """Let a peer do what it does."""
    with (
        tempfile.TemporaryFile() as said,
        subprocess.Popen([*_LAST, program, str(port)], stderr=said) as process,
    ):
        try:
            time.sleep(0.5)
            yield
            if process.poll() is not None:
                said.seek(0)
            assert process.poll() is None, f"the peer has given up: {said.read().decode()}"
        finally:
            process.kill()


@pytest.mark.parametrize(("kind", "does", "program"), PEERS, ids=[f"{kind} {does}" for kind, does, _ in PEERS])
def test_it_costs_the_lines_and_the_other_doors_nothing(served, bystander, kind, does, program):
    """Measured again, at most twice, where the machine is busy."""
    if kind not in served.ports:
        pytest.skip(f"the installed drivecomm has no door {kind}; install it again")
    measured = []
    for _ in range(RUNS):
        # Nobody connects to a broker elsewhere.
        with peer(program, free_port() if kind in BROKERS else bystander):
            calm = Seen(served)
        with peer(program, served.ports[kind]):
            full = Seen(served)
        # What is under way to the history is there.
        time.sleep(COMMITTED_EVERY_S * 2)
        measured.append(
            f"{kind} {does}: late {full.late_p95():.4f} s; a bystander's {calm.late_p95():.4f}; "
            f"others answered in {full.wait_p95():.4f} s; a bystander's {calm.wait_p95():.4f}"
        )
        _LOG.info(measured[-1])
        keeps_time = full.late_p95() < max(0.0, calm.late_p95()) + LATER_S.get((kind, does), 0.05)
        if keeps_time and full.wait_p95() < calm.wait_p95() + 0.05:
            break
    else:
        pytest.fail("\n".join(measured))
    assert served.drive("fan")["reachability"] == "answers"
