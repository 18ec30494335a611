"""The queue of results for a slow reader of a poll plan, and the pauses of its lines."""

import asyncio

import pytest

import drivecomm
from drivecomm.line import delivery as delivery_module
from drivecomm.line.delivery import MOST_WAITING, NAP_S, Delivery
from drivecomm.line.poll_items import PollItem, PollResult
from drivecomm.virtual import VirtualLine, virtual_drive

RESULT = PollResult(None, "pump", "481", None, "", None, 0.0, 0.0, 0.0, 0.0, 0)


def full():
    rung = []
    delivery = Delivery(lambda: rung.append(1))
    for _ in range(MOST_WAITING):
        assert delivery.nap_s() == 0
        delivery.give(RESULT)
    assert len(rung) == MOST_WAITING
    return delivery


def test_lines_nap_until_a_slow_reader_has_taken_a_result():
    delivery = full()
    assert delivery.nap_s() == NAP_S
    assert next(delivery.read()) is RESULT
    assert delivery.nap_s() == 0


def test_lines_of_an_abandoned_plan_do_not_nap():
    delivery = full()
    delivery.stopped = True
    assert delivery.nap_s() == 0


def test_error_of_a_line_follows_its_results():
    delivery = Delivery(lambda: None)
    delivery.left = 2
    delivery.give(RESULT)
    delivery.end()
    delivery.end(RuntimeError("broken"))
    reading = delivery.read()
    assert next(reading) is RESULT
    with pytest.raises(RuntimeError, match="broken"):
        next(reading)
    assert delivery.left == 1


def test_async_lines_send_nothing_while_their_reader_is_slow(monkeypatch):
    monkeypatch.setattr(delivery_module, "MOST_WAITING", 4)

    async def main():
        lines = [VirtualLine([virtual_drive("vabus", 1)]) for _ in range(2)]
        async with drivecomm.open_bus_async(lines[0].port) as one, drivecomm.open_bus_async(lines[1].port) as two:
            drives = [bus.drive("vabus", 1) for bus in (one, two)]
            results = drivecomm.poll_async([PollItem(drive=each, parameter="481", period_s=0) for each in drives])
            await anext(results)
            for _ in range(2000):
                await asyncio.sleep(0)
            asked = sum(bus.counters["vabus:1"]["requests"] for bus in (one, two))
            await results.aclose()
            return asked

    assert 4 < asyncio.run(main()) < 20
