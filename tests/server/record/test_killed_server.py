"""The central record has every row of a server's own history once, however often the server was killed."""

import os
import signal

import pytest
from mosquitto import mosquitto, needs_mosquitto
from processes import QUICK, serving
from recorders import COUNTS, LONG, FileRecord, recording, until

from drivecomm.server.history import History

HISTORY = QUICK + 'history = {{ file = "{file}" }}\n'
DOOR = '[[door]]\nkind = "mqtt"\nbroker = "mqtt://127.0.0.1:{port}"\nprefix = "drivecomm/hall"\nmessages = "drives"\n'
VALUES = "SELECT drive, quantity, time FROM sample"
EVENTS = "SELECT number, time FROM event"

pytestmark = [
    needs_mosquitto,
    pytest.mark.soak,
    pytest.mark.skipif(os.name != "posix", reason="signals and unix sockets are POSIX's"),
]


@pytest.mark.timeout(4000 if LONG else 180)
def test_record_has_every_row_of_the_history_of_a_killed_server(tmp_path):
    record, kept = FileRecord(tmp_path), tmp_path / "kept.sqlite"
    with (
        mosquitto(tmp_path / "broker") as broker,
        recording(broker.url, record.url),
        serving(tmp_path, head=HISTORY.format(file=kept), tail=DOOR.format(port=broker.port)) as one,
    ):
        until(lambda: record.all(COUNTS)[0][0] > 0)
        for _ in range(200 if LONG else 2):
            with broker.away():
                until_more(lambda: len(rows(kept)[0]), 5)
                one.end(signal.SIGKILL)
            one.start()
            until_more(lambda: record.all(COUNTS)[0][0], 20)
        one.end()
        one.start()
        # The new run publishes the rows of earlier runs that are missing.
        values, events = rows(kept)
        until(lambda: values <= recorded(record, VALUES) and events <= recorded(record, EVENTS))
        taken = record.all(VALUES)
    assert len(taken) == len(set(taken))


def rows(kept):
    """Return the values and events in the history of the server, by their keys."""
    with History(kept) as history:
        values = [(each.drive, each.name, round(each.time_s * 1000)) for each in history.since(0)]
        events = [(each.event.number, round(each.event.time_s * 1000)) for each in history.events()]
    assert len(values) == len(set(values))
    return set(values), set(events)


def until_more(count, by):
    before = count()
    until(lambda: count() > before + by)


def recorded(record, question):
    return set(record.all(question))
