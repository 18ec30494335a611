"""The history as doors read it: by rows, in pieces, and while it is written."""

import asyncio
import threading
from contextlib import aclosing
from decimal import Decimal

import pytest

from drivecomm.errors import UsageError
from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue
from drivecomm.server.history import History, HistoryFile
from drivecomm.server.history_service import HistoryService

NOON = 1_795_000_000.0


def values(first, count):
    return [
        CurrentValue(
            drive="pump", name="f", quality="good", time_s=NOON + number,
            reading=Reading(parameter="1", value=Decimal(number), raw=number, unit="Hz", time_s=NOON + number),
        )
        for number in range(first, first + count)
    ]  # fmt: skip


async def rows_since(past, row):
    async with aclosing(past.since(row)) as pieces:
        return [each.row async for piece in pieces for each in piece]


def test_rows_are_read_from_any_row_to_the_end(tmp_path):
    store = HistoryFile(tmp_path / "history.sqlite")
    past = HistoryService(tmp_path / "history.sqlite")

    async def test():
        assert await past.last_row() == 0
        assert await rows_since(past, 0) == []
        store.add(values(0, 2500), [])
        assert await past.last_row() == 2500
        assert await rows_since(past, 0) == list(range(1, 2501))
        assert await rows_since(past, 2498) == [2499, 2500]
        assert await rows_since(past, 9999) == []
        async with aclosing(past.since(0)) as pieces:
            async for piece in pieces:
                # A reader must not block the writer.
                store.add(values(9000, 1), [])
                assert 0 < len(piece) <= 1000
                break

    asyncio.run(test())
    store.close()


def test_pieces_of_a_quantity_have_its_values_in_a_time_span(tmp_path):
    store = HistoryFile(tmp_path / "history.sqlite")
    store.add(values(0, 2500), [])
    past = HistoryService(tmp_path / "history.sqlite")

    async def test():
        async with aclosing(past.pieces("pump", "f", NOON + 10, NOON + 2200)) as pieces:
            found = [piece async for piece in pieces]
        assert [each.value for piece in found for each in piece] == list(range(10, 2201))
        assert max(map(len, found)) <= 1000
        with pytest.raises(UsageError, match="no drive 'pumq'; did you mean 'pump'"):
            await anext(past.pieces("pumq", "f", 0, NOON))

    asyncio.run(test())
    store.close()
    readers = [each for each in threading.enumerate() if each.name.startswith("history for a door")]
    for each in readers:
        each.join(10)
    assert not any(each.is_alive() for each in readers)


def test_many_requests_open_few_files_and_do_not_block_other_threads(tmp_path, monkeypatch):
    file = tmp_path / "history.sqlite"
    store = HistoryFile(file)
    store.add(values(0, 10), [])
    release, opened, most = threading.Event(), [], []

    class Slow(History):
        def __enter__(self):
            opened.append(self)
            most.append(len(opened))
            assert release.wait(20)
            return super().__enter__()

        def __exit__(self, *error):
            opened.remove(self)
            return super().__exit__(*error)

    monkeypatch.setattr("drivecomm.server.history_service.History", Slow)
    past = HistoryService(file)

    async def test():
        asked = [asyncio.create_task(past.points("pump", "f", 0, 2 * NOON, 10)) for _ in range(100)]
        while len(opened) < 4:  # noqa: ASYNC110 - counts threads
            await asyncio.sleep(0.001)
        # Other uses of the thread pool, such as a login, still get a thread.
        await asyncio.wait_for(asyncio.gather(*(asyncio.to_thread(len, "") for _ in range(100))), 10)
        assert len(opened) == 4
        release.set()
        assert all(await asyncio.gather(*asked))

    asyncio.run(test())
    assert max(most) == 4
    store.close()
