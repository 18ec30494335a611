"""The history as doors read it: by rows, in pieces, while it is written."""

import asyncio
from contextlib import aclosing
from decimal import Decimal

from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue
from drivecomm.server.history import Store
from drivecomm.server.past import Past

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


def test_rows_are_read_from_any_on_and_to_the_end(tmp_path):
    store = Store(tmp_path / "history.sqlite")
    past = Past(tmp_path / "history.sqlite")

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
                # Who reads holds up nobody who writes.
                store.add(values(9000, 1), [])
                assert 0 < len(piece) <= 1000
                break

    asyncio.run(test())
    store.close()
