"""Every message of the plants is recorded once, even if recorder, broker or database is killed."""

import json
import os

import pytest
from mosquitto import mosquitto, needs_mosquitto
from nats_server import nats_server, needs_nats
from played_plants import played_plants, publishing
from postgres import needs_postgres, postgres
from recorders import COUNTS, LONG, TWICE, FileRecord, recording, settled, until

pytestmark = [
    pytest.mark.timeout(7200 if LONG else 180),
    pytest.mark.soak,
    pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's"),
]

ROUNDS = 300 if LONG else 1
KEEPS = ("persistence true", "autosave_on_changes true", "autosave_interval 1", "max_queued_messages 0")
"""Mosquitto settings: undelivered messages of a session are stored on disk, without a limit."""


@pytest.fixture(params=["mosquitto", "nats"])
def broker(request, tmp_path):
    if request.param == "mosquitto":
        request.applymarker(needs_mosquitto)
        with mosquitto(tmp_path / "broker", *KEEPS, f"persistence_location {tmp_path}/broker/") as running:
            running.version = "5"
            yield running
    else:
        with nats_server(tmp_path / "broker") as running:
            running.version = "3.1.1"
            yield running


@pytest.fixture
def database():
    with postgres() as running:
        yield running


def brokers(*names):
    marks = {"mosquitto": needs_mosquitto, "nats": needs_nats}
    return pytest.mark.parametrize("broker", [pytest.param(name, marks=marks[name]) for name in names], indirect=True)


def begun(record, played):
    """Wait until the recorder has subscribed, since the broker queues messages only after a first subscription."""

    def is_heard():
        played.say_that_one_is_there()
        return record.all("SELECT count(*), 0 FROM plant")[0][0] > 0

    until(is_heard)
    played.publish()
    played.taken()
    # Every message from now on is queued, so the record must end up with all of them and no other.
    until(lambda: record.all(COUNTS)[0] == (played.published, played.events))


@brokers("mosquitto", "nats")
def test_record_file_has_values_and_events_of_all_plants_once(tmp_path, broker):
    record = FileRecord(tmp_path)
    with recording(broker.url, record.url) as recorder, played_plants(broker.url, version=broker.version) as played:
        begun(record, played)
        for _ in range(20):
            played.publish()
        found = record.all("SELECT plant, count(DISTINCT drive), count(DISTINCT quantity) FROM sample GROUP BY plant")
        assert found == [(f"plant {number}", 2, 2) for number in range(3)]
        played.taken()
        out, err = recorder.end()
    assert err == ""
    assert "values recorded" in out
    assert record.all(TWICE)[0][0] == 0


@needs_postgres
@brokers("mosquitto", "nats")
def test_killed_recorder_and_database_lose_and_duplicate_nothing(broker, database):
    with recording(broker.url, database.url) as recorder, played_plants(broker.url, version=broker.version) as played:
        until(lambda: database.all("SELECT to_regclass('drivecomm.record')") != [(None,)])
        begun(database, played)
        with publishing(played):
            for _ in range(ROUNDS):
                recorder.kill()
                until_published(played, 40)
                recorder.start()
                until_published(played, 40)
                with database.away():
                    until_published(played, 40)
                until_recorded_anew(database)
        found, wanted = settled(database, played)
        assert found == wanted
        _, told = recorder.end()
    assert database.all(TWICE)[0][0] == 0
    assert "it is tried again" in told
    assert "is connected again" in told


@needs_postgres
@brokers("mosquitto", "nats")
def test_killed_broker_loses_no_message_for_the_recorder(broker, database):
    with recording(broker.url, database.url), played_plants(broker.url, version=broker.version) as played:
        until(lambda: database.all("SELECT to_regclass('drivecomm.record')") != [(None,)])
        begun(database, played)
        with publishing(played):
            for _ in range(ROUNDS):
                until_published(played, 40)
                with broker.away():
                    pass
                until_recorded_anew(database)
        found, wanted = settled(database, played)
        assert found == wanted
    assert database.all(TWICE)[0][0] == 0


@needs_postgres
@brokers("nats")
def test_nats_killed_without_a_recorder_keeps_every_message(broker, database):
    with recording(broker.url, database.url) as recorder, played_plants(broker.url, version="3.1.1") as played:
        until(lambda: database.all("SELECT to_regclass('drivecomm.record')") != [(None,)])
        begun(database, played)
        recorder.kill()
        for _ in range(50):
            played.publish()
        played.taken()
        with broker.away():
            pass
        recorder.start()
        found, wanted = settled(database, played)
        assert found == wanted


@needs_postgres
@brokers("mosquitto")
def test_recorders_with_share_split_the_messages(broker, database):
    with (
        recording(broker.url, database.url, "--name", "one", "--share", "all", "--json") as one,
        recording(broker.url, database.url, "--name", "two", "--share", "all", "--json") as two,
        played_plants(broker.url) as played,
    ):
        until(lambda: database.all("SELECT to_regclass('drivecomm.record')") != [(None,)])
        begun(database, played)
        with publishing(played, 0.005):
            until_published(played, 100)
            two.kill()
            until_published(played, 100)
            two.start()
            until_published(played, 100)
        found, wanted = settled(database, played)
        assert found == wanted
        shares = [json.loads(each.end()[0])["values"] for each in (one, two)]
    assert min(shares) > 100, shares
    assert database.all(TWICE)[0][0] == 0


@brokers("mosquitto")
def test_recorders_of_the_same_name_report_the_conflict(tmp_path, broker):
    record = FileRecord(tmp_path)
    with recording(broker.url, record.url) as one, recording(broker.url, record.url) as other:
        told = []

        def hears(line_of):
            told.append(line_of.stderr.readline())
            return "give each its own --name" in told[-1]

        until(lambda: hears(one.process) or hears(other.process))


def until_published(played, rounds):
    count = played.events + rounds * 3
    until(lambda: played.events >= count)


def until_recorded_anew(database):
    before = database.all(COUNTS)[0][0]
    until(lambda: database.all(COUNTS)[0][0] > before)
