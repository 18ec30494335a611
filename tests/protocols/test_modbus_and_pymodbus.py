"""Virtual drives tested with a foreign master and the library with a foreign drive: pymodbus in each framing."""

import asyncio
import socket
import threading
from contextlib import contextmanager

import pytest
from serving_threads import served_in_thread

import drivecomm
from drivecomm.errors import RefusedError, StateError, UsageError
from drivecomm.virtual import Server, parse_listen, virtual_drive

pymodbus = pytest.importorskip("pymodbus", reason="pymodbus is not installed; it comes with the extra bench")

from pymodbus import FramerType  # noqa: E402 - after the check that pymodbus is installed
from pymodbus.client import ModbusTcpClient  # noqa: E402
from pymodbus.server import ModbusTcpServer  # noqa: E402
from pymodbus.simulator import DataType, SimData, SimDevice  # noqa: E402


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def foreign_master(drive, framer=FramerType.RTU):
    """Yield a pymodbus client as the master of a virtual drive."""
    port = free_port()
    with served_in_thread(Server([drive], parse_listen(f"tcp:127.0.0.1:{port}"))):
        client = ModbusTcpClient("127.0.0.1", port=port, framer=framer, timeout=3)
        try:
            assert client.connect()
            yield client
        finally:
            client.close()


@contextmanager
def foreign_drive(framer=FramerType.RTU):
    """Yield the port of a drive made by pymodbus, whose registers 0 to 65535 hold 0."""
    port, loop, up = free_port(), asyncio.new_event_loop(), threading.Event()
    held = []

    async def serve():
        device = SimDevice(1, simdata=[SimData(0, count=0x3000, values=0, datatype=DataType.REGISTERS)])
        held.append(ModbusTcpServer(device, framer=framer, address=("127.0.0.1", port)))
        await held[0].listen()
        up.set()
        await held[0].serving

    def run():
        asyncio.set_event_loop(loop)
        try:
            loop.run_until_complete(serve())
        except asyncio.CancelledError:
            pass
        finally:
            loop.close()

    thread = threading.Thread(target=run)
    thread.start()
    assert up.wait(5)
    try:
        yield f"socket://127.0.0.1:{port}"
    finally:
        asyncio.run_coroutine_threadsafe(held[0].shutdown(), loop)
        thread.join(5)


FRAMINGS = {"rtu": FramerType.RTU, "ascii": FramerType.ASCII, "tcp": FramerType.SOCKET}


@pytest.mark.parametrize("framing", FRAMINGS)
def test_pymodbus_starts_and_stops_a_virtual_delta(framing):
    drive = virtual_drive("modbus", 1, model="delta", framing=framing)
    with foreign_master(drive, FRAMINGS[framing]) as client:
        assert client.write_register(0x2001, 2500, device_id=1).registers == [2500]
        assert not client.write_registers(0x2000, [0x12], device_id=1).isError()
        assert drive.motor.running
        assert drive.motor.target_hz == 25.0
        assert client.read_holding_registers(0x2102, count=2, device_id=1).registers[0] == 2500
        refused = client.read_holding_registers(0x7777, count=1, device_id=1)
        assert refused.isError()
        assert refused.exception_code == 2
        client.write_register(0x2000, 0x01, device_id=1)
        assert drive.motor.target_hz == 0.0


def test_pymodbus_sets_coils_and_32_bit_values_of_a_virtual_danfoss():
    drive = virtual_drive("modbus", 1, model="danfoss-fc")
    with foreign_master(drive) as client:
        assert client.write_coil(64, True, device_id=1).bits[0]
        assert client.read_coils(64, count=1, device_id=1).bits[0]
        assert not client.write_registers(3409, [0, 450], device_id=1).isError()
        assert drive.peek("3410", 1.0) == 450
        assert client.read_holding_registers(3409, count=2, device_id=1).registers == [0, 450]


@pytest.mark.parametrize("framing", ["ascii", "tcp"])
def test_pymodbus_drive_is_read_and_written_in_each_framing(framing):
    with foreign_drive(FRAMINGS[framing]) as place, drivecomm.open_bus(place) as bus:
        drive = bus.drive("modbus", 1, framing=framing)
        drive.write("0x0100", 0x12345678, type="u32")
        assert [drive.read(address).value for address in ("0x0100", "0x0101")] == [0x1234, 0x5678]
        with pytest.raises(RefusedError, match="code 2: unknown address"):
            drive.read("0x4000")


def test_pymodbus_drive_is_read_over_modbus_tcp():
    with foreign_drive(FramerType.SOCKET) as place:
        port = place.replace("socket://", "modbus-tcp://")
        with drivecomm.open_bus(port) as bus:
            drive = bus.drive("modbus", 1)
            drive.write("0x0100", 0x1234)
            assert drive.read("0x0100").value == 0x1234
            assert [found.address for found in bus.scan(addresses=[1])] == [1]
            with pytest.raises(UsageError, match="vabus is not supported at modbus-tcp"):
                bus.drive("vabus", 1)
            with pytest.raises(UsageError, match="framing='rtu' cannot be at modbus-tcp"):
                bus.drive("modbus", 2, framing="rtu")


@pytest.mark.soak
def test_pymodbus_drive_is_commanded_by_the_library():
    with foreign_drive() as place, drivecomm.open_bus(place) as bus:
        drive = bus.drive("modbus", 1, model="gs2", state_timeout_s=0.2)
        plain = bus.drive("modbus", 1)
        drive.set_reference(hz=25)
        with pytest.raises(StateError, match="taken back"):
            drive.start()
        assert drive.read("0x091B").value == 0
        # From here on the drive reports that it runs.
        plain.write("0x2101", 3)
        drive.start(reverse=True)
        assert [drive.read(address).value for address in ("0x091B", "0x091C")] == [1, 1]
        assert str(drive.read("0x091A")) == "25.0 Hz"
        drive.stop()
        assert drive.read("0x091B").value == 0
        plain.write("0x0100", 0x12345678, type="u32")
        assert [plain.read(address).value for address in ("0x0100", "0x0101")] == [0x1234, 0x5678]
        with pytest.raises(RefusedError, match="code 2: unknown address"):
            plain.read("0x4000")
