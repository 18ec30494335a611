"""Behaviour of a poll plan common to one or many lines, blocking or async callers, and one or many threads."""

import asyncio
import time
from contextlib import ExitStack, contextmanager

import pytest
from polled_lines import KINDS, SERVED, Site
from two_faces import open_on

from drivecomm.bus import open_bus_async
from drivecomm.errors import RefusedError, UsageError
from drivecomm.line import PollItem, poll_async
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture(params=KINDS)
def site_with(request):
    @contextmanager
    def made(**options):
        with ExitStack() as stack:
            yield Site(request.param, stack, **options)

    made.is_served = KINDS[request.param][0] in SERVED
    return made


@pytest.fixture
def site(site_with):
    with site_with() as made:
        yield made


def test_plan_reads_the_value_of_each_drive(site):
    for number, drive in enumerate(site.drives):
        drive.poke("481", 1000 + 100 * number)
    results = list(site.poll("480", "481", period_s=0.02, cycles=5))
    assert {result.error for result in results} == {None}
    for number in range(len(site.drives)):
        mine = [result for result in results if result.drive == f"line {number}"]
        assert len(mine) == 10
        assert [result.due_s for result in mine] == sorted(result.due_s for result in mine)
        assert {result.reading.value for result in mine if result.parameter == "481"} == {10 + number}


def test_plan_continues_beside_a_bad_parameter(site):
    results = list(site.poll("481", "999", "480", period_s=0.02, cycles=2))
    assert [result.quality for result in results if result.parameter == "999"] == ["bad"] * 2 * len(site.buses)
    assert {result.quality for result in results if result.parameter != "999"} == {"good"}
    assert {type(result.error) for result in results if result.error} == {RefusedError}


def test_plan_ends_when_its_reader_closes_it(site):
    results = site.poll("481", period_s=0)
    assert {next(results).error for _ in range(30)} == {None}
    results.close()
    site.assert_free()


def test_plan_ends_when_a_bus_is_closed(site):
    results = site.poll("481", period_s=0.01)
    next(results)
    site.buses[0].close()
    with pytest.raises(UsageError, match="this bus is closed"):
        for _ in results:
            pass
    if len(site.buses) > 1:
        site.assert_free()


def test_plan_ends_with_the_error_of_a_trace_function_and_frees_the_lines(site_with):
    if site_with.is_served:
        pytest.skip("the trace of a served line is read beside its calls, and ends none of them")
    broken = []

    def trace(event):
        if event.what == "received" and not broken:
            broken.append(True)
            raise RuntimeError("broken")

    with site_with(trace=trace) as site:
        with pytest.raises(RuntimeError, match="broken"):
            list(site.poll("481", period_s=0))
        site.assert_free()


def test_plan_waits_for_a_slow_reader(site, monkeypatch):
    monkeypatch.setattr("drivecomm.line.delivery.MOST_WAITING", 2)
    monkeypatch.setattr("drivecomm.line.delivery.NAP_S", 0.001)
    due = {}
    for number, result in enumerate(site.poll("481", period_s=0.05, cycles=30)):
        assert result.error is None
        assert result.due_s == pytest.approx(due.get(result.drive, result.due_s) + 0.05 * result.missed)
        assert site.in_real_time or not result.missed
        due[result.drive] = result.due_s + 0.05
        if number < 3:
            # This takes many naps of the lines.
            time.sleep(0.02)
    assert number == 30 * len(site.buses) - 1


def test_async_plan_leaves_no_task_behind():
    async def main():
        async with open_bus_async(VirtualLine([virtual_drive("vabus", 1)]).port) as one:
            items = [PollItem(drive=one.drive("vabus", 1), parameter="481", period_s=0)]
            async with open_bus_async(VirtualLine([virtual_drive("vabus", 1)]).port) as other:
                items.append(PollItem(drive=other.drive("vabus", 1), parameter="481", period_s=0))
                results = poll_async(items)
                await anext(results)
                await results.aclose()
                return len(asyncio.all_tasks())

    assert asyncio.run(main()) == 1


def test_async_plan_gives_the_same_results():
    def results(face):
        with open_on(face, VirtualLine([virtual_drive("vabus", 1)]).port) as bus:
            drive = bus.drive("vabus", 1, model="agile")
            names = ("481", "999", "480")
            items = [PollItem(drive=drive, parameter=each, period_s=0.2, priority=at) for at, each in enumerate(names)]
            return [
                (each.parameter, each.quality, each.cause, each.due_s, each.late_s, each.took_s)
                for each in bus.poll(items, duration_s=5.0)
            ]

    assert len(results("threads")) == 75
    assert results("tasks") == results("threads")
