"""Audit of commands: written before a command is sent; correct on a full disk, after a kill, and at its size limit."""

import asyncio
import errno
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from threading import Event

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from drivecomm.errors import NotAllowedError, StateError
from drivecomm.protocol import Stop
from drivecomm.server import audit as audit_module
from drivecomm.server.audit import Audit
from drivecomm.server.audit_lines import AuditFile
from drivecomm.server.callers import Caller, Role
from drivecomm.server.door import CommandAnswer, CommandRequest
from drivecomm.server.leases import Lease

ANNA = Caller(name="anna", role=Role.OPERATE, door="http 127.0.0.1:8080")
KEY = "a-key-of-22-characters"
START = CommandRequest(drive="pump", verb="start", id="17", lease=KEY, arguments={"reverse": False})
LEASE = Lease(drive="pump", holder=ANNA, until_s=0.0, key=KEY)
WALL_S = 1_790_000_000.1239


def lines_of(path):
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def with_audit(path, use, **options):
    """Run `use` with an audit, close the audit, and return the messages it reported."""
    told = []

    async def run():
        audit = Audit(path, told.append, clock=lambda: WALL_S, **options)
        try:
            await use(audit)
        finally:
            await audit.close()
        await asyncio.sleep(0)

    asyncio.run(run())
    return told


def test_added_lines_are_synced_to_the_disk_before_add_returns(tmp_path, monkeypatch):
    path, synced = tmp_path / "audit.jsonl", []

    def fsync(descriptor):
        found = os.fstat(descriptor)
        synced.append((found.st_ino, found.st_size))

    monkeypatch.setattr("drivecomm.server.audit_lines.os.fsync", fsync)
    file = AuditFile(path)
    for number in (1, 2):
        file.add([b"one\n", b"two\n"])
        assert synced[-1] == (path.stat().st_ino, 8 * number)
    file.close()
    # One sync of the new file's folder, then one of the file for each batch.
    assert len(synced) == 3


def test_audit_records_a_command_and_its_outcome(tmp_path):
    path = tmp_path / "state" / "audit.jsonl"

    async def use(audit):
        number = await audit.record_command(ANNA, START, LEASE)
        assert [each["record"] for each in lines_of(path)] == ["asked"], "the record must precede the command"
        error = StateError("the drive\nis not ready")
        audit.outcome(ANNA, START, number, CommandAnswer(id="17", outcome="failed", error=error))
        audit.refused(ANNA, replace(START, verb="write", arguments={"value": Decimal("10.00")}), "no right")
        number = audit.record_stop(ANNA, CommandRequest(drive="pump", verb="stop", arguments={"how": Stop.COAST}))
        audit.outcome(ANNA, CommandRequest(drive="pump", verb="stop"), number, CommandAnswer(id="", outcome="done"))

    assert not with_audit(path, use, session="s1")
    who = {"who": "anna", "role": "operate", "door": "http 127.0.0.1:8080", "drive": "pump"}
    begin = {"time": "2026-09-21T14:13:20.123Z", "session": "s1"}
    start = {**begin, **who, "number": 1, "verb": "start", "arguments": {"reverse": False}, "id": "17"}
    assert lines_of(path) == [
        {**start, "record": "asked", "decision": "allowed", "holder": "anna (http 127.0.0.1:8080)"},
        {**start, "record": "outcome", "outcome": "failed", "why": "the drive is not ready"},
        {
            **start,
            "number": 2,
            "verb": "write",
            "arguments": {"value": 10.0},
            "record": "asked",
            "decision": "refused",
            "why": "no right",
        },
        {
            **begin,
            **who,
            "number": 3,
            "verb": "stop",
            "arguments": {"how": "coast"},
            "record": "asked",
            "decision": "allowed",
        },
        {**begin, **who, "number": 3, "verb": "stop", "record": "outcome", "outcome": "done"},
    ]
    assert '"value":10.00' in path.read_text(), "decimals keep their digits"
    if os.name == "posix":
        assert path.stat().st_mode & 0o777 == 0o600


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full disk")
def test_full_disk_refuses_every_command_except_a_stop(tmp_path):
    path = tmp_path / "audit.jsonl"
    path.symlink_to("/dev/full")

    async def use(audit):
        with pytest.raises(NotAllowedError) as caught:
            await audit.record_command(ANNA, START, LEASE)
        assert str(caught.value) == (
            "start of pump was not sent, because its audit record cannot be written: "
            f"{path}: No space left on device; a stop would still be sent"
        )
        begun = time.perf_counter()
        for _ in range(1000):
            audit.record_stop(ANNA, CommandRequest(drive="pump", verb="stop"))
        assert time.perf_counter() - begun < 1, "a stop must not wait"
        with pytest.raises(NotAllowedError):
            await audit.record_command(ANNA, START, LEASE)
        # The disk has room again.
        path.unlink()
        await audit.record_command(ANNA, START, LEASE)
        await audit.record_command(ANNA, START, LEASE)

    told = with_audit(path, use)
    assert told == [
        f"{path}: No space left on device; only stops are sent until it can be written",
        f"{path}: commands are recorded again; 1002 records are missing",
    ]
    assert [(each["record"], each.get("missing")) for each in lines_of(path)] == [
        ("gap", 1002), ("asked", None), ("asked", None),
    ]  # fmt: skip


def test_unwritable_audit_folder_is_reported_at_the_start(tmp_path):
    (tmp_path / "state").write_text("no folder")

    async def use(audit):
        await asyncio.sleep(0.1)
        with pytest.raises(NotAllowedError, match=r"audit.jsonl: File exists|audit.jsonl: Not a directory"):
            await audit.record_command(ANNA, START)

    assert len(with_audit(tmp_path / "state" / "audit.jsonl", use)) == 1


def test_hanging_disk_refuses_commands_and_counts_missing_stops(tmp_path, monkeypatch):
    go_on, real = Event(), os.fsync
    monkeypatch.setattr(os, "fsync", lambda descriptor: go_on.wait(10) and real(descriptor))
    monkeypatch.setattr(audit_module, "LONGEST_WAIT_S", 0.1)
    monkeypatch.setattr(audit_module, "_MOST_WAITING", 5)
    path = tmp_path / "audit.jsonl"

    async def use(audit):
        begun = time.perf_counter()
        for _ in range(2):
            with pytest.raises(NotAllowedError, match="the disk does not answer; a stop would still be sent"):
                await audit.record_command(ANNA, START)
        for number in range(20):
            audit.record_stop(ANNA, CommandRequest(drive=f"fan{number}", verb="stop"))
        with pytest.raises(NotAllowedError, match="the disk does not answer"):
            await audit.record_command(ANNA, START)
        assert time.perf_counter() - begun < 5
        go_on.set()
        monkeypatch.setattr(audit_module, "LONGEST_WAIT_S", 5.0)
        await asyncio.sleep(0.1)
        await audit.record_command(ANNA, replace(START, drive="last"))

    told = with_audit(path, use)
    assert ["the disk does not answer" in each for each in told] == [True, False]
    written = lines_of(path)
    assert written[-1]["drive"] == "last"
    missing = sum(each.get("missing", 0) for each in written)
    stops = [each for each in written if each.get("verb") == "stop"]
    starts = [each for each in written if each.get("verb") == "start" and each["record"] == "asked"]
    assert len(stops) <= 5
    assert missing >= 20 - len(stops), "the number of missing records must be written"
    assert [each["drive"] for each in starts] == ["last"], "a command that was not sent must have no record"


def test_cancelled_command_leaves_no_record(tmp_path, monkeypatch):
    go_on, real = Event(), os.fsync
    monkeypatch.setattr(os, "fsync", lambda descriptor: go_on.wait(10) and real(descriptor))

    async def use(audit):
        waiting = asyncio.create_task(audit.record_command(ANNA, START))
        await asyncio.sleep(0.05)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        await asyncio.sleep(0.05)
        go_on.set()

    with_audit(tmp_path / "audit.jsonl", use)
    assert not lines_of(tmp_path / "audit.jsonl")


SECRET = "0123456789abcdefghijkl"
TEXTS = st.one_of(st.text(), st.just(SECRET), st.just(f"x{SECRET}y"), st.just('","decision":"allowed'))
VALUES = st.recursive(
    st.one_of(
        TEXTS, st.integers(), st.floats(), st.decimals(), st.none(), st.booleans(), st.binary(), st.just(10**4000)
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(TEXTS, inner, max_size=3)),
    max_leaves=8,
)


@pytest.mark.soak
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arguments=st.dictionaries(TEXTS, VALUES, max_size=3), lease=st.one_of(st.just(SECRET), st.text(max_size=3)))
def test_any_command_is_one_line_without_its_lease_key(tmp_path, arguments, lease):
    path = tmp_path / "audit.jsonl"
    path.unlink(missing_ok=True)
    command = CommandRequest(drive="pump", verb="write", lease=lease, arguments={**arguments, "again": lease})

    async def use(audit):
        await audit.record_command(ANNA, command)

    with_audit(path, use)
    (line,) = path.read_bytes().splitlines()
    content = json.loads(line)
    assert (content["decision"], content["who"]) == ("allowed", "anna")
    if lease == SECRET:
        assert SECRET.encode() not in line
    assert len(line) < 100_000


def test_audit_omits_keys_tokens_and_passwords(tmp_path):
    arguments = dict.fromkeys(("key", "Lease", "token", "PASSWORD"), "Kq7secret")

    async def use(audit):
        await audit.record_command(ANNA, replace(START, arguments={**arguments, "deeper": dict(arguments)}), LEASE)

    with_audit(tmp_path / "audit.jsonl", use)
    text = (tmp_path / "audit.jsonl").read_text()
    assert "Kq7secret" not in text
    assert KEY not in text


def test_audit_shortens_very_long_arguments(tmp_path):
    deep = []
    for _ in range(200):
        deep = [deep]
    arguments = {"a": "x" * 1_000_000, "b": list(range(100_000)), "c": deep, "d": 10**9999}

    async def use(audit):
        await audit.record_command(ANNA, replace(START, arguments=arguments, id="y" * 1_000_000))

    with_audit(tmp_path / "audit.jsonl", use)
    assert (tmp_path / "audit.jsonl").stat().st_size < 10_000


def test_incomplete_line_is_terminated_at_the_next_start(tmp_path):
    path = tmp_path / "audit.jsonl"
    path.write_bytes(b'{"whole":1}\n{"half":')

    async def use(audit):
        await audit.record_command(ANNA, START)

    with_audit(path, use)
    first, second, third = path.read_bytes().splitlines()
    assert (first, second, json.loads(third)["who"]) == (b'{"whole":1}', b'{"half":', "anna")


def test_partly_written_line_does_not_damage_later_lines(tmp_path, monkeypatch):
    path = tmp_path / "audit.jsonl"
    file = AuditFile(path)
    file.add([b"one\n"])
    real = os.write
    room = [5]

    def write(descriptor, data):
        if not room[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = real(descriptor, bytes(data)[: room[0]])
        room[0] -= written
        return written

    monkeypatch.setattr(os, "write", write)
    for _ in range(3):
        with pytest.raises(OSError, match="No space"):
            file.add([b"two two two\n"])
    monkeypatch.setattr(os, "write", real)
    file.add([b"three\n", b"four\n"])
    assert path.read_bytes() == b"one\ntwo t\nthree\nfour\n"


@pytest.mark.parametrize("size", [1, 50, 100])
def test_rotation_loses_only_the_lines_of_the_oldest_file(tmp_path, size):
    path = tmp_path / "audit.jsonl"
    file = AuditFile(path, file_bytes=size, files=3)
    for number in range(100):
        file.add([b"%03d\n" % number])
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        "audit.jsonl", "audit.jsonl.1", "audit.jsonl.2", "audit.jsonl.3",
    ]  # fmt: skip
    kept = b"".join((tmp_path / f"audit.jsonl{end}").read_bytes() for end in (".3", ".2", ".1", ""))
    numbers = [int(line) for line in kept.splitlines()]
    assert numbers == list(range(numbers[0], 100))
    assert len(numbers) > 3 * max(1, size // 4)


@pytest.mark.parametrize("before", [0, 1, 2])
def test_kill_during_rotation_loses_no_line(tmp_path, monkeypatch, before):
    """before: number of files already renamed at the kill."""
    path = tmp_path / "audit.jsonl"
    file = AuditFile(path, file_bytes=4, files=9)
    for number in range(4):
        file.add([b"%03d\n" % number])
    real, left = Path.replace, [before]

    def replace_some(old, new):
        if not left[0]:
            raise KeyboardInterrupt
        left[0] -= 1
        return real(old, new)

    monkeypatch.setattr(Path, "replace", replace_some)
    with pytest.raises(KeyboardInterrupt):
        file.add([b"004\n"])
    monkeypatch.setattr(Path, "replace", real)
    again = AuditFile(path, file_bytes=4, files=9)
    for number in range(5, 8):
        again.add([b"%03d\n" % number])
    names = sorted(tmp_path.iterdir(), key=lambda each: each.name, reverse=True)
    kept = [int(line) for each in [*names[:-1], names[-1]] for line in each.read_bytes().splitlines()]
    assert kept == [0, 1, 2, 3, 5, 6, 7]


def test_audit_file_keeps_growing_if_it_cannot_be_renamed(tmp_path, monkeypatch):
    def refused(*_):
        raise PermissionError(errno.EACCES, "no")

    monkeypatch.setattr(Path, "replace", refused)
    file = AuditFile(tmp_path / "audit.jsonl", file_bytes=4, files=2)
    for number in range(5):
        file.add([b"%03d\n" % number])
    assert (tmp_path / "audit.jsonl").read_bytes().split() == [b"%03d" % number for number in range(5)]


@pytest.mark.skipif(os.name != "posix", reason="Windows cannot move an open file")
@pytest.mark.parametrize("how", ["moved", "removed"])
def test_moved_or_removed_audit_file_is_created_again(tmp_path, how):
    path = tmp_path / "audit.jsonl"
    file = AuditFile(path)
    file.add([b"one\n"])
    if how == "moved":
        path.rename(tmp_path / "away")
    else:
        path.unlink()
    file.add([b"two\n"])
    assert path.read_bytes() == b"two\n"


KILLED = """
import asyncio, sys
from pathlib import Path
from drivecomm.server.audit import Audit
from drivecomm.server.callers import Caller, Role
from drivecomm.server.door import CommandRequest

async def main():
    audit = Audit(Path(sys.argv[1]), print, file_bytes=20_000, files=100)
    anna = Caller(name="anna", role=Role.OPERATE, door="http")
    async def commands(who):
        for number in range(10_000):
            await audit.record_command(anna, CommandRequest(drive="pump", verb="start", id=f"{who}-{number}"))
            print(f"{who}-{number}", flush=True)
    await asyncio.gather(*map(commands, range(5)))
asyncio.run(main())
"""


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
def test_records_written_before_a_kill_are_in_the_file(tmp_path):
    path = tmp_path / "audit.jsonl"
    with subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True) as program:
        sent = [program.stdout.readline().strip() for _ in range(300)]
        program.send_signal(signal.SIGKILL)
        sent += [line.strip() for line in program.stdout if line.endswith("\n")]
    found = set()
    for file in tmp_path.iterdir():
        for line in file.read_bytes().splitlines(keepends=True):
            if line.endswith(b"\n"):
                found.add(json.loads(line)["id"])
    assert set(sent) <= found


def test_concurrent_records_share_one_sync(tmp_path, monkeypatch):
    flushed, real = [], os.fsync
    monkeypatch.setattr(os, "fsync", lambda descriptor: flushed.append(1) or real(descriptor))

    async def use(audit):
        await asyncio.gather(*(audit.record_command(ANNA, replace(START, id=str(number))) for number in range(200)))

    with_audit(tmp_path / "audit.jsonl", use)
    assert sorted(int(each["id"]) for each in lines_of(tmp_path / "audit.jsonl")) == list(range(200))
    assert len(flushed) < 100
