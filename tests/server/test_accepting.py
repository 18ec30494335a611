"""Acceptance of connections by a door: limits, replaced connections, and exhausted file descriptors."""

import asyncio
import contextlib
import socket
import ssl
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from drivecomm.server import Acceptor, Bounds
from drivecomm.server.accepting import origin_of


class Guest(asyncio.Protocol):
    """A client whose first byte gives its readiness to yield: 0 to 9, or any other byte for never."""

    made = 0

    def __init__(self):
        Guest.made += 1
        self.place, self.number = 0, Guest.made

    def connection_made(self, transport):
        self.transport = transport
        transport.write(b".")

    def data_received(self, data):
        self.place = None if data == b"-" else int(data)
        self.transport.write(b"!")

    def yields(self, *, to_known):
        return None if self.place is None or (self.place == 9 and not to_known) else (self.place, self.number)


class Door:
    """A listening socket with its acceptor."""

    def __init__(self, **given):
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.acceptor = Acceptor(made=lambda _: Guest(), **given)

    async def connect(self, says=b"", source="127.0.0.1"):
        """Connect; return reader and writer, None if the door closes the connection."""
        address = self.listening.getsockname()[:2]
        reader, writer = await asyncio.open_connection(*address, local_addr=(source, 0))
        if await first(reader) != b".":
            writer.close()
            return None
        if says:
            writer.write(says)
            assert await reader.readexactly(1) == b"!"
        return reader, writer


async def first(reader):
    try:
        return await asyncio.wait_for(reader.read(1), 5)
    except ConnectionError:
        return b""


def run(test, **given):
    """Run a test with a door, in a new event loop."""

    async def in_loop():
        door = Door(**given)
        with door.listening:
            running = asyncio.create_task(door.acceptor.run(door.listening))
            try:
                await asyncio.wait_for(test(door), 20)
            finally:
                running.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await running
                for place in door.acceptor._places:
                    place.cut_off()
                await asyncio.sleep(0.01)

    asyncio.run(in_loop())


def close(*connected):
    for _, writer in connected:
        writer.close()


def test_most_yielding_connection_makes_room_for_a_newcomer():
    async def test(door):
        there = [await door.connect(says) for says in (b"-", b"2", b"1", b"1")]
        there.append(await door.connect(b"-"))
        assert await first(there[2][0]) == b""
        there.append(await door.connect(b"-"))
        assert await first(there[3][0]) == b""
        there.append(await door.connect(b"-"))
        assert await first(there[1][0]) == b""
        assert await door.connect() is None
        close(*there)

    run(test, bounds=Bounds(4, 4))


def test_connections_of_one_address_do_not_displace_those_of_another():
    async def test(door):
        others = [await door.connect(b"1", source="127.0.0.2") for _ in range(2)]
        own = [await door.connect(b"1") for _ in range(5)]
        for reader, writer in others:
            writer.write(b"1")
            assert await reader.readexactly(1) == b"!"
        assert [await first(reader) for reader, _ in own[:3]] == [b""] * 3
        close(*others, *own)

    run(test, bounds=Bounds(100, 2))


def test_some_connections_yield_only_to_a_known_newcomer():
    async def test(door):
        there = [await door.connect(b"9", source="127.0.0.2") for _ in range(2)]
        assert await door.connect(source="127.0.0.3") is None
        there.append(await door.connect())
        assert await first(there[0][0]) == b""
        close(*there)

    run(test, bounds=Bounds(2, 2), known=lambda address: address == "127.0.0.1")


def test_disconnected_clients_free_their_places():
    async def test(door):
        for _ in range(20):
            there = [await door.connect(b"-") for _ in range(2)]
            close(*there)
            await asyncio.sleep(0.01)

    run(test, bounds=Bounds(2, 2))


def test_connection_without_a_tls_handshake_makes_room():
    """A connection counts against the limit from its acceptance, before the TLS handshake."""

    async def test(door):
        address = door.listening.getsockname()
        mute = [socket.create_connection(address) for _ in range(3)]
        loop = asyncio.get_running_loop()
        for each in mute:
            each.setblocking(False)
        assert await asyncio.wait_for(loop.sock_recv(mute[0], 1), 5) == b""
        for each in mute:
            each.close()

    run(test, bounds=Bounds(2, 2), tls=ssl.create_default_context(ssl.Purpose.CLIENT_AUTH))


def test_spare_descriptors_admit_connections_when_no_other_is_left():
    """A door serves as many connections as it has spare descriptors; the next ones wait, without a busy loop."""
    program = f"""
        import asyncio, os, resource, socket, sys, time
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from test_accepting import Door, Bounds, first
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))

        async def main():
            door = Door(bounds=Bounds(1000, 1000), spare=2)
            running = asyncio.create_task(door.acceptor.run(door.listening))
            await asyncio.sleep(0.01)
            clients = [socket.socket() for _ in range(3)]
            used_up = []
            try:
                while True:
                    used_up.append(os.open(os.devnull, os.O_RDONLY))
            except OSError:
                pass
            loop = asyncio.get_running_loop()
            for each in clients[:2]:
                each.setblocking(False)
                await loop.sock_connect(each, door.listening.getsockname())
                assert await loop.sock_recv(each, 1) == b"."
                await loop.sock_sendall(each, b"-")
                assert await loop.sock_recv(each, 1) == b"!"
            waits = clients[2]
            waits.setblocking(False)
            await loop.sock_connect(waits, door.listening.getsockname())
            began = time.process_time()
            heard = asyncio.create_task(loop.sock_recv(waits, 1))
            done, _ = await asyncio.wait([heard], timeout=1)
            assert not done
            assert time.process_time() - began < 0.5
            os.close(used_up.pop())
            assert await asyncio.wait_for(heard, 5) == b"."
            assert not running.done()
            os._exit(0)

        asyncio.run(main())
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], check=False, timeout=60)
    assert done.returncode == 0


def test_spare_descriptors_are_released_when_needed_and_reopened_later():
    program = """
        import asyncio, os, resource, time
        from drivecomm.server import spare
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
        spare._LOOK_S = 0.01

        def free():
            opened = []
            try:
                while True:
                    opened.append(os.open(os.devnull, os.O_RDONLY))
            except OSError:
                return opened

        async def until(number):
            while True:
                opened = free()
                for each in opened:
                    os.close(each)
                if len(opened) == number:
                    return
                await asyncio.sleep(0.01)

        async def main():
            holding = asyncio.create_task(spare.give_up_when_exhausted(8))
            await asyncio.sleep(0)
            used_up = free()
            await until(8)
            for _ in range(10):
                os.close(used_up.pop())
            await until(10)
            os._exit(0)

        asyncio.run(asyncio.wait_for(main(), 10))
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], check=False, timeout=60)
    assert done.returncode == 0


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("::1", "::1"),
        ("", ""),
    ],
)
def test_origin_is_the_address_part_that_a_peer_cannot_choose(address, expected):
    assert origin_of(address) == expected


@given(st.ip_addresses())
def test_origin_does_not_depend_on_letter_case(address):
    assert origin_of(str(address)) == origin_of(str(address).upper())
