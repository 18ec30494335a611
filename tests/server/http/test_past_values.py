"""Raw history values by HTTP, as CSV and JSON lines: sent in pieces, to a limited number of readers."""

import csv
import io
import time

import pytest

from drivecomm.client import parsed
from drivecomm.server.http import history_routes

PATH = "/api/v1/history?drive=pump&name=output_frequency&from=10&to=20.5"


@pytest.mark.parametrize(
    ("query", "accept"), [("&format=csv", "*/*"), ("", "text/csv"), ("", "text/html, text/csv;q=0.9")]
)
def test_history_csv_has_every_value_with_all_its_digits(local, plant, query, accept):
    found = local.get(PATH + query, Accept=accept)
    assert found.status == 200
    assert found.headers["Content-Type"] == "text/csv; charset=utf-8"
    rows = list(csv.DictReader(io.StringIO(found.content.decode())))
    assert [each["time"] for each in rows] == ["1970-01-01T00:00:10.000Z", "1970-01-01T00:00:11.000Z"]
    assert {(each["drive"], each["name"], each["value"]) for each in rows} == {("pump", "output_frequency", "10.50")}
    assert plant.history.asked == [("pump", "output_frequency", 10, 20.5)]


def test_history_json_lines_have_every_value(local):
    found = local.get(f"{PATH}&format=ndjson")
    assert found.headers["Content-Type"] == "application/x-ndjson"
    values = [parsed(each) for each in found.content.splitlines()]
    assert [(each["row"], str(each["value"])) for each in values] == [
        (0, "10.50"), (1, "10.50"),
    ]  # fmt: skip


def test_history_is_thinned_unless_raw_values_are_requested(local):
    assert "points" in local.get(f"{PATH}&format=json", Accept="text/csv").content
    assert "points" in local.get(PATH, Accept="*/*").content
    assert local.get(f"{PATH}&format=xml").status == 422


def test_raw_values_of_an_unknown_quantity_are_an_error(local):
    found = local.get("/api/v1/history?drive=pump&name=unread&format=csv")
    assert (found.status, found.content["error"]["kind"]) == (422, "UsageError")


def test_raw_values_of_an_empty_span_have_only_a_header(local, plant):
    plant.history.count = 0
    assert local.get(f"{PATH}&format=csv").content.decode().splitlines() == [",".join(history_routes.COLUMNS)]
    assert local.get(f"{PATH}&format=ndjson").content == b""


def test_head_request_for_raw_values_reads_no_further_piece(local, plant):
    plant.history.count = 1000
    assert local.ask("HEAD", f"{PATH}&format=csv").headers["Content-Type"] == "text/csv; charset=utf-8"
    assert plant.history.ended.wait(10)
    assert plant.history.taken == -1


def begun(local):
    connected = local.connect()
    connected.sendall(f"GET {PATH}&format=csv HTTP/1.1\r\nHost: x\r\n\r\n".encode())
    assert connected.recv(12) == b"HTTP/1.1 200"
    return connected


def until(condition):
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_third_concurrent_reader_gets_503_and_stops_still_work(local, plant):
    plant.history.count = 10**9
    with begun(local), begun(local):
        found = local.get(f"{PATH}&format=csv")
        assert (found.status, found.headers["Retry-After"]) == (503, "5")
        assert local.get(PATH).status == 200
        assert local.post("/api/v1/stop").status == 200
    # A reader that disconnects makes room for the next.
    plant.history.count = 1
    until(lambda: local.get(f"{PATH}&format=csv").status == 200)


def test_stalled_reader_of_raw_values_is_disconnected(local, plant, monkeypatch):
    monkeypatch.setattr(history_routes, "NOT_READING_S", 0.2)
    monkeypatch.setattr(history_routes, "_written", lambda *_: "x" * 100_000)
    plant.history.count = 10**9
    with begun(local):
        assert plant.history.ended.wait(10)
    # Only as much is read from the history as fits in the buffers.
    assert plant.history.taken < 200
