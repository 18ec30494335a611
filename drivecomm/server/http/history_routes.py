"""Routes of the history: the curve of a quantity, its values as read, and events."""

from __future__ import annotations

import asyncio
import csv
import io
import time
from contextlib import aclosing
from typing import TYPE_CHECKING, Annotated, Literal

from fastapi import Query
from starlette.exceptions import HTTPException
from starlette.responses import Response

from drivecomm.client import json_text, plain
from drivecomm.plant.value_log import COLUMNS
from drivecomm.server import log_row
from drivecomm.server.http import answers
from drivecomm.server.http.fields import Limit, Text, Time
from drivecomm.server.http.route import V1, ApiRequest, json_answer, route
from drivecomm.server.http.stream import NOT_READING_S

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Sequence

    from starlette.types import Receive, Scope, Send

    from drivecomm.server import PastValue, PlantHistory

_DAY_S = 86400.0
_FORMS = {"csv": "text/csv; charset=utf-8", "ndjson": "application/x-ndjson"}
_From = Annotated[
    Time | None,
    Query(alias="from", description="the earliest time, in seconds since 1970; one day before the latest unless given"),
]
_To = Annotated[Time | None, Query(alias="to", description="the latest time, in seconds since 1970; now unless given")]
_Form = Annotated[
    Literal["json", "csv", "ndjson"] | None,
    Query(alias="format", description="csv, ndjson: every value as it was read; as in Accept unless given"),
]


@route("GET", f"{V1}/history", answers.Points, others=tuple(_FORMS.values()))
async def history(
    asked: ApiRequest,
    *,
    drive: Annotated[Text, Query(description="the drive's name")],
    name: Annotated[Text, Query(description="the quantity, as it is polled")],
    from_s: _From = None,
    to_s: _To = None,
    points: Annotated[int, Query(ge=2, le=10_000, description="approximate number of points, if thinned")] = 500,
    form: _Form = None,
) -> Response:
    """Past values of a quantity: thinned for a plot, or every value as CSV or as JSON lines."""
    accept = asked.headers.get("accept", "")
    chosen: str = form or next((each for each, of in _FORMS.items() if of.partition(";")[0] in accept), "json")
    span = _span(from_s, to_s)
    if chosen == "json":
        return json_answer({"points": await _journal(asked).points(drive, name, *span, points)})
    if asked.door.readers.locked():
        raise HTTPException(
            503, "another client is reading the history; try again in a few seconds", {"Retry-After": "5"}
        )
    pieces = _journal(asked).pieces(drive, name, *span)
    # An unknown quantity raises here, before the response has begun.
    first: Sequence[PastValue] = await anext(pieces, [])
    return _Pieces(asked, first, pieces, chosen)


@route("GET", f"{V1}/history/events", answers.Events)
async def past_events(
    asked: ApiRequest,
    *,
    drive: Annotated[Text, Query(description="of this drive only")] = "",
    kind: Annotated[Text, Query(description="of this kind only, such as fault")] = "",
    from_s: _From = None,
    to_s: _To = None,
    limit: Limit = 1000,
) -> Response:
    """Events of this and earlier runs, the oldest first."""
    begin_s, end_s = _span(from_s, to_s)
    return json_answer(await _journal(asked).events(drive=drive, kind=kind, from_s=begin_s, to_s=end_s, limit=limit))


class _Pieces(Response):
    """Streamed values: the next batch is read when the client has taken the previous one."""

    def __init__(
        self,
        asked: ApiRequest,
        first: Sequence[PastValue],
        pieces: AsyncGenerator[Sequence[PastValue], None],
        form: str,
    ) -> None:
        super().__init__(headers={"Content-Type": _FORMS[form], "Vary": "Accept"})
        del self.headers["content-length"]
        self._asked, self._piece, self._pieces, self._form = asked, first, pieces, form

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG002 - as Starlette calls it
        transport = scope["state"]["transport"]
        async with self._asked.door.readers, aclosing(self._pieces):
            await send({"type": "http.response.start", "status": 200, "headers": self.raw_headers})
            text = f"{','.join(COLUMNS)}\r\n" if self._form == "csv" else ""
            while self._piece and not transport.is_closing() and "is_head" not in scope:
                began = time.monotonic()
                # In a thread, followed by a pause of the same length, so that lines and streams come first.
                text += await asyncio.to_thread(_written, self._piece, self._form)
                try:
                    async with asyncio.timeout(NOT_READING_S):
                        await send({"type": "http.response.body", "body": text.encode(), "more_body": True})
                except TimeoutError:
                    transport.abort()
                    return
                await asyncio.sleep(time.monotonic() - began)
                self._piece, text = await anext(self._pieces, []), ""
            await send({"type": "http.response.body", "body": text.encode()})


def _written(values: Sequence[PastValue], form: str) -> str:
    if form == "ndjson":
        return "".join(f"{json_text(plain(each))}\n" for each in values)
    text = io.StringIO()
    csv.DictWriter(text, COLUMNS).writerows(log_row(each).texts() for each in values)
    return text.getvalue()


def _journal(asked: ApiRequest) -> PlantHistory:
    if asked.plant.history is None:
        raise HTTPException(404, "this server keeps no history; leave history = false out of its plant file")
    return asked.plant.history


def _span(from_s: float | None, to_s: float | None) -> tuple[float, float]:
    to_s = time.time() if to_s is None else to_s
    return to_s - _DAY_S if from_s is None else from_s, to_s
