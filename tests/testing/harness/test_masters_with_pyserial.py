"""Masters with pyserial on virtual lines in this process: virtual time, and the errors of pyserial."""

import gc
import time
from concurrent.futures import ThreadPoolExecutor
from threading import Thread

import pytest
import serial

from drivecomm.testing import pyserial
from drivecomm.testing.pyserial import protocol_virtual

ENQUIRY = b"\x04A00481\x05"
LENGTH = 19


def opened(drive, **settings):
    return serial.serial_for_url(
        drive.port, **{"baudrate": 19200, "bytesize": 7, "parity": "E", "timeout": 1, **settings}
    )


@pytest.fixture
def drive(virtual_drive):
    made = virtual_drive("vabus:1", listen="virtual")
    made.poke("481", 2550)
    return made


def ask(port):
    port.write(ENQUIRY)
    return port.read(LENGTH)


def test_pyserial_master_reads_a_virtual_drive(drive):
    with opened(drive) as port:
        assert int(ask(port)[9:17], 16) == 2550
    drive.assert_received(kind="enquiry", parameter=481, times=1)


def test_ten_minutes_of_silence_take_no_time(drive):
    began = time.monotonic()
    with opened(drive) as port:
        for _ in range(600):
            assert len(ask(port)) == LENGTH
            assert port.read(1) == b""
    assert drive.line.now() > 600
    assert time.monotonic() - began < 10


def test_drive_ignores_a_master_with_other_line_settings(drive):
    with opened(drive, baudrate=1200, bytesize=8, parity="N") as port:
        assert ask(port) == b""
        port.baudrate, port.bytesize, port.parity = 19200, 7, "E"
        assert len(ask(port)) == LENGTH


@pytest.mark.parametrize("settings", [{"baudrate": 10}, {"bytesize": 5}])
def test_unsupported_line_settings_raise_serial_exception(drive, settings):
    with pytest.raises(serial.SerialException):
        opened(drive, **settings)


def test_unread_bytes_stay_until_read_or_reset(drive):
    with opened(drive) as port:
        port.write(ENQUIRY)
        first = port.read(1)
        assert len(first + port.read(100)) == LENGTH
        port.write(ENQUIRY)
        port.read(1)
        drive.line.advance(1)
        port.reset_input_buffer()
        assert port.in_waiting == 0


def test_polling_in_waiting_advances_virtual_time(drive):
    with opened(drive, timeout=0) as port:
        port.write(ENQUIRY)
        port.flush()
        while port.in_waiting < LENGTH:
            assert drive.line.now() < 1
        assert len(port.read(LENGTH)) == LENGTH
        assert port.read(1) == b""


def test_read_without_timeout_returns_bytes_under_way(drive):
    with opened(drive, timeout=None) as port:
        assert len(ask(port)) == LENGTH


def test_read_without_timeout_raises_if_no_bytes_can_come(drive, monkeypatch):
    monkeypatch.setattr(protocol_virtual, "PATIENCE_S", 0.05)
    with opened(drive, timeout=None) as port, pytest.raises(serial.SerialException, match="give the port a timeout"):
        port.read(1)


def test_reading_thread_gets_the_reply_to_another_threads_request(drive):
    found = []
    with opened(drive, timeout=None) as port:
        reader = Thread(target=lambda: found.append(port.read(LENGTH)))
        reader.start()
        port.write(ENQUIRY)
        reader.join(10)
    assert [len(each) for each in found] == [LENGTH]


def test_closing_a_port_ends_a_blocked_read(drive):
    found = []
    port = opened(drive, timeout=None)
    reader = Thread(target=lambda: found.append(port.read(LENGTH)))
    reader.start()
    port.close()
    reader.join(10)
    assert not reader.is_alive()
    with pytest.raises(serial.PortNotOpenError):
        port.write(b"x")


def test_unplugged_adapter_raises_serial_exception(drive):
    with opened(drive) as port:
        drive.line.virtual.broken = True
        with pytest.raises(serial.SerialException, match="broken"):
            port.write(ENQUIRY)


def test_unknown_virtual_url_raises_serial_exception():
    with pytest.raises(serial.SerialException, match="no virtual line virtual://0"):
        serial.serial_for_url("virtual://0")


def test_line_keeps_its_url_and_can_be_garbage_collected():
    from drivecomm.virtual import VirtualLine

    line = VirtualLine()
    url = pyserial.serial_url(line)
    assert pyserial.serial_url(line) == url
    assert pyserial.line_at(url) is line
    del line
    gc.collect()
    assert pyserial.line_at(url) is None


def test_python_clocks_follow_the_line(virtual_drive):
    drive = virtual_drive("vabus:1", listen="virtual", model="agile")
    real = time.monotonic()
    with opened(drive) as port, drive.line.clock():
        began, wall, ticks = time.monotonic(), time.time(), time.perf_counter()
        while time.monotonic() < began + 600:
            ask(port)
            time.sleep(1)
        assert time.time() - wall == pytest.approx(600, abs=2)
        assert time.perf_counter() - ticks == pytest.approx(600, abs=2)
    assert time.monotonic() - real < 10


def test_system_clocks_are_restored_after_the_block(drive):
    clocks = time.sleep, time.monotonic, time.perf_counter, time.time
    with drive.line.clock():
        assert time.sleep is not clocks[0]
    assert (time.sleep, time.monotonic, time.perf_counter, time.time) == clocks


def test_watchdog_of_ten_minutes_trips_in_virtual_time(drive):
    """413 of a VABus drive is the time without an exchange after which it trips with F2010 (VEC 383, p. 35)."""
    drive.poke("413", 600)
    real = time.monotonic()
    with opened(drive) as port, drive.line.clock():
        ask(port)
        time.sleep(590)
        ask(port)
        assert not drive.motor.fault
        time.sleep(610)
        ask(port)
        assert drive.motor.fault
    assert time.monotonic() - real < 5


def held_up_by_a_read(drive, port, work):
    """Run `work` in a thread during a read of another thread; return whether the work had to wait for the read."""
    done = []
    thread = Thread(target=lambda: done.append(work()))

    def begin():
        thread.start()
        thread.join(0.1)
        done_meanwhile.append(bool(done))

    done_meanwhile = []
    drive.line.call_at(drive.line.now() + 0.5, begin)
    assert port.read(1) == b""
    thread.join(10)
    assert done
    return not done_meanwhile[0]


def test_sleep_waits_for_the_read_of_another_thread(drive):
    with opened(drive) as port, drive.line.clock():
        assert held_up_by_a_read(drive, port, lambda: time.sleep(1) or True)
    assert drive.line.now() == pytest.approx(2, abs=0.1)


def test_advance_waits_for_the_read_of_another_thread(drive):
    with opened(drive) as port:
        assert held_up_by_a_read(drive, port, lambda: drive.line.advance(1) or True)


def test_write_to_a_second_port_waits_for_a_read_on_the_first(drive):
    with opened(drive) as port, opened(drive) as other:
        assert held_up_by_a_read(drive, port, lambda: other.write(ENQUIRY))


def test_two_threads_of_a_master_share_a_port_and_the_clock(drive):
    """One thread sends requests and sleeps, the other polls for replies, all in the line's time."""
    found = bytearray()

    def asking():
        for _ in range(100):
            port.write(ENQUIRY)
            time.sleep(1)

    def looking():
        until = time.monotonic() + 200
        while len(found) < 100 * LENGTH and time.monotonic() < until:
            if port.in_waiting:
                found.extend(port.read(port.in_waiting))
            time.sleep(0.01)

    with opened(drive, timeout=0) as port, drive.line.clock(), ThreadPoolExecutor(2) as threads:
        for each in [threads.submit(looking), threads.submit(asking)]:
            each.result(60)
    drive.assert_received(kind="enquiry", parameter=481, times=100)
    assert len(found) == 100 * LENGTH


def test_sleep_of_another_thread_lets_bytes_arrive_for_a_read(drive):
    with opened(drive, timeout=None) as port, drive.line.clock(), ThreadPoolExecutor(1) as threads:
        reading = threads.submit(port.read, 3)
        drive.line.call_at(100.0, lambda: drive.line.inject(b"abc"))
        time.sleep(200)
        assert reading.result(10) == b"abc"


def test_clocks_in_nanoseconds_follow_the_line(drive):
    with drive.line.clock():
        began = time.monotonic_ns(), time.time_ns(), time.perf_counter_ns()
        time.sleep(600)
        ended = time.monotonic_ns(), time.time_ns(), time.perf_counter_ns()
    assert [after - before for before, after in zip(began, ended, strict=True)] == pytest.approx([600e9] * 3)


def test_modem_lines_are_all_set(drive):
    with opened(drive) as port:
        assert (port.cts, port.dsr, port.cd, port.ri) == (True, True, True, False)
