"""Rate limit of reads by network callers, and the requests that it never delays."""

import asyncio

import pytest
from fake_plant import Client, FakeUsers
from hypothesis import given, strategies as st
from served_core import ENGINEER, VIEWER, asked, awaited, core_of, until

from drivecomm.client import error_content, error_of
from drivecomm.errors import TooOftenError
from drivecomm.server import Bucket, CommandRequest, Rate
from drivecomm.server.http import HttpDoor
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.rates import Rates
from drivecomm.server.supervision import OpenDoor
from drivecomm.tomlfile import TomlTable

SLOW = Rate(per_s=0.01, burst=3)


def reads(number, drive="pump"):
    return CommandRequest(drive=drive, verb="read", id=str(number), arguments={"parameter": "output_frequency"})


@given(
    st.floats(0.1, 100), st.integers(1, 50), st.lists(st.tuples(st.floats(0, 3), st.integers(1, 5)), max_size=100)
)  # fmt: skip
def test_bucket_admits_at_most_its_rate_in_any_time_span(per_s, burst, asked_for):
    rate, bucket, now, cost = Rate(per_s, burst), Bucket(burst, 0.0), 0.0, 0
    for pause_s, each in asked_for:
        now += pause_s
        wait_s = bucket.wait_s(rate, now, each)
        if wait_s:
            assert Bucket(bucket.left, bucket.at_s).wait_s(rate, now + wait_s * 1.001) == 0
            assert Bucket(bucket.left, bucket.at_s).wait_s(rate, now + wait_s * 0.999) > 0
        else:
            cost += each
            # The last request may cost more than the remaining tokens.
            assert cost - each <= burst + per_s * now + 1e-6


def test_bucket_gets_no_tokens_while_the_clock_stands_still():
    bucket = Bucket(1.0, 5.0)
    assert bucket.wait_s(Rate(1, 1), 5.0) == 0
    assert bucket.wait_s(Rate(1, 1), 4.0) == 1.0


def test_each_caller_and_line_has_its_own_bucket():
    rates = Rates(Rate(1, 1))
    assert rates.wait_s(("anna", "hall"), 0.0) == 0
    assert rates.wait_s(("anna", "hall"), 0.0) > 0
    assert rates.wait_s(("anna", "yard"), 0.0) == 0
    assert rates.wait_s(("ben", "hall"), 0.0) == 0
    for number in range(20_000):
        rates.wait_s((str(number), "hall"), 0.0)
    assert len(rates._buckets) == 10_000


@awaited
async def test_read_of_many_parameters_counts_each_of_them(tmp_path):
    async with core_of(tmp_path) as (core, _):
        plant = PlantForDoors(core, "hall", read_rate=Rate(per_s=1.0, burst=3))
        await until(lambda: core.drive("pump").reachability == "answers")
        many = CommandRequest(drive="pump", verb="read_many", arguments={"parameters": ["output_frequency"] * 5})
        assert (await plant.command(VIEWER, many)).outcome == "done"
        answer = await plant.command(VIEWER, reads(1))
        assert answer.outcome == "refused"
        assert isinstance(answer.error, TooOftenError)
        assert 2.0 < answer.error.wait_s <= 3.0


@awaited
async def test_rate_limit_does_not_apply_to_local_callers_or_other_lines(tmp_path):
    async with core_of(tmp_path) as (core, _):
        plant = PlantForDoors(core, "hall", read_rate=SLOW)
        await until(lambda: all(each.reachability == "answers" for each in core.drives()))
        outcomes = [(await plant.command(VIEWER, reads(number))).outcome for number in range(5)]
        assert outcomes == ["done"] * 3 + ["refused"] * 2
        assert (await plant.command(VIEWER, reads(1, "fan"))).outcome == "done"
        assert (await plant.command(ENGINEER, reads(1))).outcome == "done"


@awaited
async def test_http_door_answers_429_to_reads_but_not_to_stops_and_leases(tmp_path):
    async with core_of(tmp_path) as (core, _):
        plant = PlantForDoors(core, "hall", users=FakeUsers(), read_rate=SLOW)
        door = HttpDoor(TomlTable({"kind": "http", "listen": "127.0.0.1:0"}, "hall.toml"))
        opened = OpenDoor(door, plant, print)
        await until(lambda: all(each.reachability == "answers" for each in core.drives()))
        await until(opened.opened.is_set)
        try:
            await asyncio.to_thread(_ask_over_http, Client(door, "ottootto"))
        finally:
            await asyncio.to_thread(opened.close)


def _ask_over_http(client):
    key = client.post("/api/v1/drives/pump/lease", seconds=30).content["key"]
    arguments = {"parameter": "output_frequency"}
    for number in range(3):
        assert client.post("/api/v1/drives/pump/read", id=f"r{number}", arguments=arguments).status == 200
    for number in range(3, 6):
        refused = client.post("/api/v1/drives/pump/read", id=f"r{number}", arguments=arguments)
        assert refused.status == 429
        assert 1 <= int(refused.headers["Retry-After"]) <= 100
        error = error_of(refused.content["error"])
        assert isinstance(error, TooOftenError)
        assert error.wait_s > 1
        assert client.post("/api/v1/drives/pump/status", id=f"s{number}", arguments={}).status == 429
        assert client.ask("PUT", "/api/v1/drives/pump/lease", {"key": key, "seconds": 30}).status == 200
        stopped = client.post("/api/v1/drives/pump/stop", id=f"t{number}", arguments={})
        assert (stopped.status, stopped.content["outcome"]) == (200, "done")
    assert client.get("/api/v1/drives/pump").status == 200


def test_wait_time_of_an_error_survives_serialisation():
    error = error_of(error_content(TooOftenError("too often", wait_s=2.5)))
    assert isinstance(error, TooOftenError)
    assert (str(error), error.wait_s) == ("too often", 2.5)


@pytest.mark.parametrize("verb", ["status", "identify", "probe", "polled", "read_watchdog"])
@awaited
async def test_every_read_verb_counts_against_the_rate(tmp_path, verb):
    async with core_of(tmp_path) as (core, _):
        plant = PlantForDoors(core, "hall", read_rate=Rate(per_s=0.01, burst=1))
        assert (await plant.command(VIEWER, reads(1))).outcome in ("done", "failed")
        assert isinstance((await plant.command(VIEWER, CommandRequest(drive="pump", verb=verb))).error, TooOftenError)
        assert (await asked(core, VIEWER, "pump", "stop")).outcome == "done"
