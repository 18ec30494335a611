"""What the MQTT door costs: how old a value is at a subscriber, and how fast missed values follow beside live ones.

    python benchmarks/mqtt_door.py                      # 200 drives, 200,000 missed values: about two minutes
    python benchmarks/mqtt_door.py --rows 7200000       # what an hour of 500 drives with four values a second leaves
    python benchmarks/mqtt_door.py --messages drives    # one message for all values of a drive

`drivecomm serve` polls virtual drives of `drivecomm simulate` on the same machine, and publishes on a mosquitto of its
own. Age: from the last byte of a reply to a subscriber in another process, which reads it from the message.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from equal_lines import equal_lines
from history import A_COMMIT, batch_of

from drivecomm.client import identity
from drivecomm.server.history import Journal

if TYPE_CHECKING:
    from collections.abc import Sequence

_HERE = Path(__file__).parent
_LINES, _PREFIX = 20, "bench"


def main() -> None:
    """Measure; print it."""
    parser = argparse.ArgumentParser(description="Measure the MQTT door.")
    parser.add_argument("--rows", type=int, default=200_000, help="missed values")
    parser.add_argument("--drives", type=int, default=200, help="drives, each with two values and its status a second")
    parser.add_argument("--seconds", type=float, default=20.0, help="of the calm measurement")
    parser.add_argument("--messages", choices=("quantities", "drives"), default="quantities")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="dc") as folder, ExitStack() as stack:
        measure(Path(folder), stack, chosen)


def measure(folder: Path, stack: ExitStack, chosen: argparse.Namespace) -> None:
    """Serve a plant that has missed so many values."""
    port = _broker(folder, stack)
    path = folder / "plant.toml"
    path.write_text(_plant(chosen, port, _LINES), encoding="utf-8")
    command = [sys.executable, "-m", "drivecomm", "simulate", str(path), "--json"]
    simulated = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
    stack.callback(simulated.terminate)
    told = json.loads(_line(simulated))
    path.write_text(_plant(chosen, port, [line["listening"] for line in told["lines"]]), encoding="utf-8")
    environment = _missed(folder, path, port, chosen.rows)

    listener = _piped(stack, [sys.executable, str(_HERE / "mqtt_listener.py"), str(port), _PREFIX])
    _line(listener)
    began = time.monotonic()
    command = [sys.executable, "-m", "drivecomm", "serve", str(path), "--json", "--level", "error"]
    server = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment))
    stack.callback(server.terminate)
    _line(server)
    _asked(listener)
    opened, before_s = time.monotonic(), _processor_s(server.pid)
    historical, live, ages, messages = 0, 0, [], 0
    while historical < chosen.rows and time.monotonic() - opened < 600:
        time.sleep(1)
        seen = _asked(listener)
        historical, live, messages = historical + seen["historical"], live + seen["live"], messages + seen["messages"]
        ages.append((seen.get("p50_s", 0.0), seen.get("p99_s", 0.0)))
    took_s, used_s = time.monotonic() - opened, _processor_s(server.pid) - before_s
    print(f"open after {opened - began:.1f} s")
    print(
        f"missed: {historical} of {chosen.rows} values in {took_s:.1f} s ({historical / took_s:.0f} a second), beside "
        f"{live / took_s:.0f} live values a second; {used_s:.1f} s of a core in all; out of order: {seen['disorder']}"
    )
    if ages:
        p50, p99 = sorted(each[0] for each in ages)[len(ages) // 2], max(each[1] for each in ages)
        print(f"live meanwhile: age p50 {1000 * p50:.1f} ms; p99 in the worst second {1000 * p99:.1f} ms")
    time.sleep(3)
    _asked(listener)
    before_s = _processor_s(server.pid)
    time.sleep(chosen.seconds)
    seen, used_s = _asked(listener), _processor_s(server.pid) - before_s
    print(
        f"calm: {seen['live'] / chosen.seconds:.0f} values and {seen['messages'] / chosen.seconds:.0f} messages a "
        f"second; age p50 {1000 * seen['p50_s']:.2f} ms, p99 {1000 * seen['p99_s']:.1f} ms, longest "
        f"{1000 * seen['longest_s']:.0f} ms; {used_s / chosen.seconds:.2f} of a core with polling; "
        f"historical: {seen['historical']}"
    )


def _processor_s(process: int) -> float:
    """Return what all threads of a process have used so far, also those that have ended."""
    told = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK")


def _broker(folder: Path, stack: ExitStack) -> int:
    program = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if program is None:
        raise SystemExit("mosquitto is missing, the broker that this is measured with")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
    settings = folder / "mosquitto.conf"
    settings.write_text(
        f"listener {port} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\nset_tcp_nodelay true\n"
    )
    broker = stack.enter_context(subprocess.Popen([program, "-c", str(settings)], stderr=subprocess.DEVNULL))
    stack.callback(broker.terminate)
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
        except OSError:
            time.sleep(0.05)
        else:
            return port


def _plant(chosen: argparse.Namespace, port: int, ports: Sequence[str] | int) -> str:
    head = (
        f'[server]\nhistory = {{ file = "history.sqlite" }}\n[[door]]\nkind = "mqtt"\n'
        f'broker = "mqtt://127.0.0.1:{port}"\nprefix = "{_PREFIX}"\nmessages = "{chosen.messages}"'
    )
    drives = max(1, chosen.drives // _LINES)
    return equal_lines(head, ports, drives=drives, poll='parameters = ["16-13", "16-14"]')


def _missed(folder: Path, path: Path, port: int, rows: int) -> dict[str, str]:
    """Write a history of which the broker has nothing but the first value; return the server's environment."""
    state, runtime = folder / "state", folder / "run"
    for each in (state, runtime):
        each.mkdir(mode=0o700)
    journal = Journal(folder / "history.sqlite", days=100_000)
    for first in range(0, rows + A_COMMIT, A_COMMIT):
        batch = batch_of(first)
        journal.add_values(batch[: max(0, rows + 1 - first)])
        while journal.written < first - 50_000:
            time.sleep(0.01)
    journal.close(600)
    kept = sha256(f"127.0.0.1:{port} {_PREFIX}".encode()).hexdigest()[:8]
    own = state / identity(path)
    own.mkdir()
    position = {"format": 1, "row": 1, "time_ms": round(batch_of(0)[0].time_s * 1000) - 1}
    (own / f"mqtt-{kept}.json").write_text(json.dumps(position))
    return {**os.environ, "STATE_DIRECTORY": str(state), "XDG_RUNTIME_DIR": str(runtime)}


def _piped(stack: ExitStack, command: list[str]) -> subprocess.Popen[str]:
    process = stack.enter_context(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
    stack.callback(process.terminate)
    return process


def _line(process: subprocess.Popen[str]) -> str:
    line = process.stdout.readline() if process.stdout else ""
    if not line:
        raise SystemExit("a process of the measurement ended; its reason is on standard error")
    return line


def _asked(listener: subprocess.Popen[str]) -> dict[str, Any]:
    if listener.stdin is None:
        raise SystemExit("the listener has no pipe")
    listener.stdin.write("\n")
    listener.stdin.flush()
    found: dict[str, Any] = json.loads(_line(listener))
    return found


if __name__ == "__main__":
    main()
