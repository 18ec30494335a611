"""Notifications to systemd on a datagram socket; its watchdog is fed only by a running event loop."""

import asyncio
import os
import socket
import sys
import time
from contextlib import suppress

import pytest

from drivecomm.server.notify import ServiceManager

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="systemd is on Linux")


@pytest.fixture(params=["in a folder", "abstract"])
def manager_socket(request, tmp_path):
    """Yield a socket as systemd makes it, and the name under which systemd passes it."""
    name = str(tmp_path / "notify") if request.param == "in a folder" else f"@drivecomm-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(name.replace("@", "\0"))
        receiver.settimeout(2)
        yield receiver, name


@pytest.fixture
def manager(manager_socket):
    made = ServiceManager({"NOTIFY_SOCKET": manager_socket[1]})
    yield made
    made.close()


@pytest.fixture
def heard(manager_socket):
    return lambda: manager_socket[0].recv(4096).decode().splitlines()


def test_manager_is_notified_when_the_server_is_ready(manager, heard):
    manager.ready("2 lines, 5 drives")
    assert heard() == ["READY=1", "STATUS=2 lines, 5 drives"]


def test_manager_is_notified_of_a_reload_with_its_start_time(manager, heard):
    before = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    manager.reloading()
    word, at = heard()
    after = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    assert word == "RELOADING=1"
    assert before <= int(at.removeprefix("MONOTONIC_USEC=")) <= after


def test_manager_is_notified_of_the_shutdown(manager, heard):
    manager.stopping("stopping pump")
    assert heard() == ["STOPPING=1", "STATUS=stopping pump"]


def test_status_with_a_line_break_adds_no_assignment(manager, heard):
    manager.status("hall:\nSTOPPING=1")
    assert heard() == ["STATUS=hall: STOPPING=1"]


def test_watchdog_is_fed_by_a_running_loop(manager_socket, heard):
    manager = ServiceManager({"NOTIFY_SOCKET": manager_socket[1], "WATCHDOG_USEC": "90000"})

    async def run():
        task = asyncio.create_task(manager.feed_watchdog())
        await asyncio.sleep(0.2)
        task.cancel()

    asyncio.run(run())
    manager.close()
    manager_socket[0].setblocking(False)
    count = 0
    while True:
        try:
            assert heard() == ["WATCHDOG=1"]
        except BlockingIOError:
            break
        count += 1
    assert count >= 3


def test_watchdog_is_not_fed_by_a_hanging_loop(manager_socket, heard):
    manager = ServiceManager({"NOTIFY_SOCKET": manager_socket[1], "WATCHDOG_USEC": "60000"})

    async def run():
        task = asyncio.create_task(manager.feed_watchdog())
        await asyncio.sleep(0)
        assert heard() == ["WATCHDOG=1"]
        manager_socket[0].settimeout(0.2)  # this blocks the loop
        with pytest.raises(TimeoutError):
            heard()
        task.cancel()

    asyncio.run(run())
    manager.close()


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"WATCHDOG_USEC": "0"},
        {"WATCHDOG_USEC": "soon"},
        {"WATCHDOG_USEC": "1000000", "WATCHDOG_PID": "1"},
    ],
)
def test_watchdog_of_another_process_is_not_fed(manager_socket, environment):
    manager = ServiceManager({"NOTIFY_SOCKET": manager_socket[1], **environment})
    assert manager.watchdog_s is None
    asyncio.run(manager.feed_watchdog())
    manager_socket[0].setblocking(False)
    with pytest.raises(BlockingIOError):
        manager_socket[0].recv(4096)
    manager.close()


def test_watchdog_time_is_read_for_this_process():
    environment = {"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": str(os.getpid())}
    assert ServiceManager(environment).watchdog_s == 30


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "vsock:2:1234"}])
def test_manager_without_a_socket_sends_nothing(environment):
    manager = ServiceManager(environment)
    manager.ready("ready")
    manager.status("polling")
    manager.reloading()
    manager.stopping("bye")
    manager.close()
    manager.status("after the end")


def test_stalled_manager_does_not_block_and_gets_the_shutdown(tmp_path):
    name = str(tmp_path / "notify")
    manager = ServiceManager({"NOTIFY_SOCKET": name})
    manager.ready("nobody listens yet")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(name)
        manager.status("now")
        assert receiver.recv(4096).decode().splitlines() == ["READY=1", "STATUS=now"]
        began = time.monotonic()
        for number in range(2000):  # more than the queue of the socket holds
            manager.status(f"{number}")
        assert time.monotonic() - began < 2
        receiver.setblocking(False)
        with suppress(BlockingIOError):
            while receiver.recv(4096):
                pass
        manager.stopping("the end")
        assert "STOPPING=1" in receiver.recv(4096).decode().splitlines()
    manager.close()
