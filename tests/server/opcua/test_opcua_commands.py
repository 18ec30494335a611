"""Commands over OPC UA: rights, locks, outcomes, and the end of a session."""

import asyncio
from contextlib import suppress

import pytest
from asyncua import ua
from served_opcua import TOKEN, call, data, lock, node, opened, reads_good, until

from drivecomm.errors import NoReplyError
from drivecomm.server import CommandAnswer


def run(test):
    asyncio.run(test)


@pytest.mark.soak
def test_lock_ends_with_its_session_and_the_motor_stops(door):
    async def test(one):
        async with one.client("otto") as otto:
            await lock(otto)
            assert await call(otto, "Start") == ("Good", ["done", ""])
            await until(lambda: one.runs("pump"))
        await until(lambda: not one.plant.leases())
        await until(lambda: not one.runs("pump"))

    door.run(test)


def test_session_that_ends_while_it_locks_leaves_no_lock(door, monkeypatch):
    async def test(one):
        take, asked, go = one.plant.take_lease, asyncio.Event(), asyncio.Event()
        loop = asyncio.get_running_loop()

        async def take_slowly(*given):
            loop.call_soon_threadsafe(asked.set)
            await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(go.wait(), loop))
            return await take(*given)

        monkeypatch.setattr(one.plant, "take_lease", take_slowly)
        async with one.client("otto") as otto:
            locking = asyncio.create_task(call(otto, "InitLock", "a test", on="drives/pump/Lock"))
            await asyncio.wait_for(asked.wait(), 20)
        locking.cancel()
        ended = asyncio.Event()
        end = one.plant.end_lease

        async def end_and_say_so(*given):
            await end(*given)
            loop.call_soon_threadsafe(ended.set)

        monkeypatch.setattr(one.plant, "end_lease", end_and_say_so)
        go.set()
        await asyncio.wait_for(ended.wait(), 20)
        assert not one.plant.leases()

    door.run(test)


def test_cut_connection_ends_the_lock(door):
    async def test(one):
        client = one.client("otto")
        otto = await client.__aenter__()
        await lock(otto)
        assert await call(otto, "Start") == ("Good", ["done", ""])
        await until(lambda: one.runs("pump"))
        otto.uaclient.protocol.transport.abort()
        await until(lambda: not one.plant.leases())
        await until(lambda: not one.runs("pump"))
        with suppress(Exception):  # the connection is cut, which raises
            await client.__aexit__(None, None, None)

    door.run(test)


@pytest.mark.soak
def test_closing_the_door_ends_the_lock(tmp_path):
    async def test():
        async with opened(tmp_path) as one:
            client = one.client("otto")
            otto = await client.__aenter__()
            await lock(otto)
            assert await call(otto, "Start") == ("Good", ["done", ""])
            await asyncio.to_thread(one.watched.close)
            assert not one.plant.leases()
            await until(lambda: not one.runs("pump"))
            with suppress(Exception):  # the connection is cut, which raises
                await client.__aexit__(None, None, None)

    run(test())


@pytest.mark.soak
def test_drive_has_one_commander_at_a_time(door):
    async def test(one):
        async with one.client("otto") as otto, one.client("olga") as olga:
            await lock(otto)
            status, (number, text) = await call(olga, "InitLock", "me", on="drives/pump/Lock")
            assert (status, number) == ("Good", -1)
            assert "pump is commanded by otto" in text
            assert (await call(olga, "SetReference", 10.0, "%"))[0] == "BadRequiresLock"

            async def locked():
                return (await data(olga, "drives/pump/Lock/Locked")).Value.Value

            await until(locked)
            assert (await data(olga, "drives/pump/Lock/LockingUser")).Value.Value == "otto"
            assert 0 < (await data(olga, "drives/pump/Lock/RemainingLockTime")).Value.Value <= 10_000
            assert (await call(olga, "RenewLock", on="drives/pump/Lock"))[1][0] == -1
            assert (await call(olga, "BreakLock", on="drives/pump/Lock"))[1][0] == -2
            assert (await call(otto, "RenewLock", on="drives/pump/Lock"))[1][0] == 0
            assert (await call(otto, "ExitLock", on="drives/pump/Lock"))[1][0] == 0
            assert (await call(otto, "ExitLock", on="drives/pump/Lock"))[1][0] == -1
            await lock(olga)

    door.run(test)


def test_lock_belongs_to_its_session_not_to_its_user(door):
    async def test(one):
        async with one.client("otto") as otto, one.client("otto") as another:
            await lock(otto)
            assert (await call(another, "SetReference", 10.0, "%"))[0] == "BadRequiresLock"
            assert (await call(another, "ExitLock", on="drives/pump/Lock"))[1][0] == -1
            assert await call(otto, "SetReference", 10.0, "%") == ("Good", ["done", ""])

    door.run(test)


@pytest.mark.soak
def test_unconfirmed_stop_of_all_drives_is_not_good(door):
    async def test(one):
        async with one.client("otto") as otto:
            one.control.order("power", drive="fan", state="off")
            try:
                status, (outcome, text) = await call(otto, "StopAll", on="plant")
                assert status != "Good"
                assert outcome != "done"
                assert "fan first" in text
            finally:
                one.control.order("power", drive="fan", state="on")
            await until(lambda: one.core.drive("fan").reachability == "answers")

    door.run(test)


def test_unconfirmed_stop_is_bad_timeout(door, monkeypatch):
    async def silent(_caller, command):
        return CommandAnswer(id=command.id, outcome="open", error=NoReplyError("fan did not answer"))

    async def test(one):
        monkeypatch.setattr(one.plant, "command", silent)
        async with one.client("otto") as otto:
            assert await call(otto, "Stop", on="drives/fan") == ("BadTimeout", ["open", "fan did not answer"])

    door.run(test)


def test_stop_of_all_without_drives_is_refused(door, monkeypatch):
    async def nothing(*_):
        return []

    async def test(one):
        monkeypatch.setattr(one.plant, "stop_all", nothing)
        async with one.client("otto") as otto:
            told = await call(otto, "StopAll", on="plant")
            assert told == ("BadInvalidState", ["refused", "there is no drive that could be stopped"])

    door.run(test)


def test_broken_lock_refuses_further_commands(door):
    async def test(one):
        async with one.client("otto") as otto, one.client("carl") as carl:
            await lock(otto)
            assert (await call(carl, "BreakLock", on="drives/pump/Lock"))[1][0] == 0
            assert not one.plant.leases()
            status, (outcome, text) = await call(otto, "SetReference", 10.0, "%")
            assert (status, outcome) == ("BadRequiresLock", "refused")
            assert "has expired" in text
            await lock(otto)

    door.run(test)


REFUSED = [
    ("vera", "SetReference", (10.0, "%"), "pump", "BadUserAccessDenied", "needs operate"),
    ("otto", "Reverse", (), "pump", "BadUserAccessDenied", "does not allow reverse of pump over opcua"),
    ("otto", "WriteParameter", ("3-41", "12.5"), "pump", "BadUserAccessDenied", "needs commission"),
    ("carl", "WriteParameter", ("3-42", "12.5"), "pump", "BadUserAccessDenied", "does not allow write"),
    ("otto", "SetReference", (10.0, "knots"), "pump", "BadInvalidArgument", "cannot be in 'knots'"),
]


@pytest.mark.parametrize("refused", REFUSED, ids=lambda each: f"{each[0]} {each[1]} {each[3]}")
def test_refused_command_has_a_reason_and_moves_no_motor(door, refused):
    who, method, arguments, drive, status, says = refused

    async def test(one):
        async with one.client(who) as client:
            found, (outcome, text) = await call(client, method, *arguments, on=f"drives/{drive}")
            assert (found, outcome) == (status, "refused")
            assert says in text
            assert one.core.audit.asked_for == []

    door.run(test)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("method", "arguments", "status"),
    [
        ("SetReference", (), "BadArgumentsMissing"),
        ("SetReference", (10.0, "%", 1), "BadTooManyArguments"),
        ("SetReference", ("10", "%"), "BadInvalidArgument"),
        ("SetReference", (float("nan"), "%"), "BadInvalidArgument"),
        ("SetReference", ([1.0], "%"), "BadInvalidArgument"),
        ("SetReference", (10.0, ua.Variant(None, ua.VariantType.String)), "BadInvalidArgument"),
        ("SetReference", (10.0, "%" * 1000), "BadInvalidArgument"),
        ("Stop", (1,), "BadTooManyArguments"),
    ],
)
def test_invalid_arguments_are_refused(door, method, arguments, status):
    async def test(one):
        async with one.client("otto") as otto:
            assert await call(otto, method, *arguments) == (status, [])
            assert one.core.audit.asked_for == []

    door.run(test)


def test_methods_work_only_on_their_objects(door):
    async def test(one):
        async with one.client("otto") as otto:
            for on in ("plant", "lines/hall", "drives/pump/Status", "methods/Start", "types/DriveType"):
                assert await call(otto, "Start", on=on) == ("BadMethodInvalid", [])
            assert await call(otto, "InitLock", "x", on="drives/pump") == ("BadMethodInvalid", [])
            assert (await call(otto, "Start", on="drives/nobody"))[0] == "BadNodeIdInvalid"

    door.run(test)


def test_listed_parameter_is_written(door):
    async def test(one):
        async with one.client("carl") as carl:
            assert await call(carl, "WriteParameter", "3-41", "12.5") == ("Good", ["done", ""])

            async def shown():
                found = await data(carl, "drives/pump/Parameters/3-41")
                return found.Value.Value == 12.5

            await until(shown)

    door.run(test)


def test_stop_all_stops_every_drive(door):
    async def test(one):
        async with one.client("otto") as otto, one.client("vera") as vera:
            await lock(otto)
            assert await call(otto, "Start") == ("Good", ["done", ""])
            await until(lambda: one.runs("pump"))
            status, (outcome, text) = await call(vera, "StopAll", on="plant")
            assert (status, outcome) == ("Good", "done"), text
            await until(lambda: not one.runs("pump"))

    door.run(test)


@pytest.mark.soak
def test_stop_does_not_wait_for_other_calls_of_its_session(door):
    async def test(one):
        async with one.client("otto") as otto:
            await lock(otto)
            gate = asyncio.Event()
            asked = one.core.audit.record_command

            async def slowly(*given):
                await gate.wait()
                return await asked(*given)

            one.core.audit.record_command = slowly
            starting = asyncio.create_task(call(otto, "Start"))
            await asyncio.sleep(0.1)
            assert await asyncio.wait_for(call(otto, "Stop"), 2) == ("Good", ["done", ""])
            assert not starting.done()
            gate.set()
            status, (outcome, text) = await starting
            assert (status, outcome) == ("BadInvalidState", "refused"), text
            assert "was requested after" in text
            assert not one.runs("pump")

    door.run(test)


def test_user_logs_in_with_a_token_of_their_own_only(door):
    async def test(one):
        async with one.client("otto", TOKEN) as otto:
            await lock(otto)
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                async with one.client("olga", TOKEN):
                    pass

    door.run(test)


@pytest.mark.soak
def test_removed_user_is_disconnected(tmp_path):
    async def test():
        async with opened(tmp_path) as one, one.client("vera") as vera:
            client = one.client("otto")
            otto = await client.__aenter__()
            await lock(otto)
            text = one.users.read_text()
            begin = text.index('[[user]]\nname = "otto"')
            one.users.write_text(text[:begin] + text[text.index("[[user]]", begin + 1) :])
            await until(lambda: not one.plant.leases())
            await reads_good(vera, "drives/pump/Status/State")
            with suppress(Exception):  # the connection is cut, which raises
                await client.__aexit__(None, None, None)

    run(test())


def test_drive_has_only_methods_that_the_plant_allows(door):
    async def names(client, drive):
        return {(await each.read_browse_name()).Name for each in await node(client, f"drives/{drive}").get_methods()}

    async def test(one):
        async with one.client("otto") as otto:
            stops = {"Stop", "QuickStop", "Coast"}
            allowed = {"Start", "SetReference", "ResetFault", "WriteParameter"}
            assert await names(otto, "pump") == stops | allowed
            assert await names(otto, "fan") == stops

    door.run(test)
