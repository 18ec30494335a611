"""Rights of callers on a drive, by role and door."""

from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from drivecomm.bus import AsyncDrive
from drivecomm.errors import NotAllowedError, ReadOnlyError, UsageError
from drivecomm.protocol import NETWORK_VERBS, DriveConfig, NetworkAccess
from drivecomm.server.callers import ANONYMOUS, LOCAL, Caller, Role
from drivecomm.server.door import CommandRequest
from drivecomm.server.rights import NEEDS, Rights

RIGHTS = Rights("plant.toml", "users.toml")
ALL = NetworkAccess(verbs={"http": NETWORK_VERBS}, write=("3-41", "jog"))
PUMP = DriveConfig(protocol="danfoss-fc", address=1, name="pump", line="hall", armed=True, network=ALL)
HTTP = "http 127.0.0.1:8080"


def caller(role, door=HTTP, name="anna"):
    return Caller(name=name, role=role, door=door)


def command(verb, /, **arguments):
    return CommandRequest(drive="pump", verb=verb, arguments=arguments)


def may(who, what, drive=PUMP):
    try:
        RIGHTS.check(who, what, drive)
    except (NotAllowedError, ReadOnlyError):
        return False
    return True


ARGUMENTS = {"write": {"parameter": "3-41"}, "write_and_read": {"parameter": "3-41"}, "call": {"verb": "jog"}}


@pytest.mark.parametrize("verb", NEEDS)
@pytest.mark.parametrize("door", [HTTP, LOCAL])
def test_command_needs_its_role_or_a_higher_one(verb, door):
    allowed = [role for role in Role if may(caller(role, door), command(verb, **ARGUMENTS.get(verb, {})))]
    if verb == "set_watchdog" and door != LOCAL:
        assert not allowed
    else:
        assert allowed == [role for role in Role if role >= NEEDS[verb].role]


def test_reads_and_stops_need_role_view_and_commands_a_higher_role():
    for verb, needs in NEEDS.items():
        if verb in (
            "read", "read_many", "polled", "polled_many", "status", "polled_status", "wait", "identify", "probe",
            "read_watchdog", "stop",
        ):  # fmt: skip
            assert needs.role is Role.VIEW
            assert not needs.commands
        elif verb in ("write", "write_and_read", "call", "set_watchdog"):
            assert needs.role is Role.COMMISSION
            assert needs.commands
        else:
            assert needs.role is Role.OPERATE
            assert needs.commands


def test_every_verb_has_requirements_and_every_network_word_a_verb():
    declared = {
        name for name in dir(AsyncDrive) if name[0] != "_" and hasattr(getattr(AsyncDrive, name), "__wrapped__")
    }
    assert declared <= set(NEEDS)
    assert {needs.network for needs in NEEDS.values()} - {"", "write"} | {"stop"} == set(NETWORK_VERBS)


@pytest.mark.parametrize("verb", [verb for verb in NEEDS if NEEDS[verb].commands])
def test_network_command_needs_its_verb_in_the_plant_file(verb):
    who, what = caller(Role.COMMISSION), command(verb, **ARGUMENTS.get(verb, {}))
    assert not may(who, what, replace(PUMP, network=NetworkAccess()))
    assert not may(who, what, replace(PUMP, network=NetworkAccess(verbs={"mqtt": NETWORK_VERBS})))
    others = tuple(each for each in NETWORK_VERBS if each != NEEDS[verb].network)
    write = () if NEEDS[verb].network == "write" else ALL.write
    assert not may(who, what, replace(PUMP, network=NetworkAccess(verbs={"http": others}, write=write)))
    assert may(replace(who, door=LOCAL), what, replace(PUMP, network=NetworkAccess()))


@pytest.mark.parametrize("verb", [verb for verb in NEEDS if NEEDS[verb].commands])
def test_unarmed_drive_refuses_commands_unless_armed_by_a_local_caller(verb):
    unarmed = replace(PUMP, armed=False)
    what = command(verb, **ARGUMENTS.get(verb, {}))
    assert not may(caller(Role.COMMISSION), what, unarmed)
    assert not may(caller(Role.COMMISSION), replace(what, arm=True), unarmed)
    local = caller(Role.COMMISSION, LOCAL)
    assert may(local, replace(what, arm=True), unarmed)
    # `call` may be a read; the drive itself is read-only and refuses all others.
    assert may(local, what, unarmed) == (verb == "call")


@pytest.mark.parametrize("drive", [PUMP, replace(PUMP, armed=False, network=NetworkAccess())])
def test_stop_needs_only_a_known_caller(drive):
    for role in (Role.VIEW, Role.OPERATE, Role.COMMISSION):
        for door in (HTTP, LOCAL, "mqtt"):
            assert may(caller(role, door), command("stop", how="coast"), drive)
            assert may(caller(role, door), replace(command("stop"), arm=True), drive)
    with pytest.raises(NotAllowedError, match="pump is stopped only for known users; log in, or send a token"):
        RIGHTS.check(caller(Role.VIEW, name=ANONYMOUS), command("stop"), drive)
    assert not may(caller(Role.NOBODY), command("stop"), drive)


def test_reverse_start_needs_the_word_reverse():
    forwards = replace(PUMP, network=NetworkAccess(verbs={"http": ("start",)}))
    who = caller(Role.OPERATE)
    assert may(who, command("start"), forwards)
    assert may(who, command("start", reverse=False), forwards)
    for verb in ("start", "keep"):
        with pytest.raises(NotAllowedError, match="add 'reverse' to network"):
            RIGHTS.check(who, command(verb, reverse=True), forwards)


@pytest.mark.parametrize("unit", ["percent", "hz", "rpm", "machine"])
def test_negative_reference_needs_the_word_reverse_in_every_unit(unit):
    forwards_only = replace(PUMP, network=NetworkAccess(verbs={"http": ("reference",)}))
    otto = caller(Role.OPERATE)
    assert may(otto, command("set_reference", **{unit: 10}), forwards_only)
    assert may(otto, command("set_reference", **{unit: "10 m/min"}), forwards_only)
    for backwards in (-10, "-10", " -10 m/min", "-0.5m/min"):
        assert not may(otto, command("set_reference", **{unit: backwards}), forwards_only)
        assert may(otto, command("set_reference", **{unit: backwards}))


@pytest.mark.parametrize("verb", ["write", "write_and_read"])
def test_network_write_needs_a_listed_parameter_and_no_store(verb):
    who = caller(Role.COMMISSION)
    assert may(who, command(verb, parameter="3-41", value=5, store=False))
    for arguments in ({"parameter": "3-42"}, {"parameter": ""}, {}, {"parameter": 341}, {"parameter": ["3-41"]}):
        assert not may(who, command(verb, **arguments))
    with pytest.raises(NotAllowedError, match="'3-41' of pump cannot be stored over a network, because EEPROM"):
        RIGHTS.check(who, command(verb, parameter="3-41", value=5, store=True), PUMP)
    assert may(caller(Role.COMMISSION, LOCAL), command(verb, parameter="9-99", store=True))


def test_network_write_to_a_parameter_that_is_always_stored_is_refused():
    with pytest.raises(NotAllowedError, match="481 of pump cannot be stored over a network"):
        RIGHTS.check_stored(caller(Role.COMMISSION), PUMP, "481")
    RIGHTS.check_stored(caller(Role.COMMISSION, LOCAL), PUMP, "481")


@pytest.mark.parametrize("verb", ["read", "status", "stop", "start"])
@pytest.mark.parametrize("said", [{"line": "hall"}, {"options": {"model": "fc101"}}])
def test_unlisted_drives_and_options_need_a_local_caller(verb, said):
    what = replace(command(verb), **said)
    with pytest.raises(NotAllowedError, match="only for programs on the server's machine"):
        RIGHTS.check(caller(Role.COMMISSION), what, PUMP)
    assert may(caller(Role.COMMISSION, LOCAL), what) == (verb != "start" or "line" not in said)


def test_errors_name_the_plant_file_entry_to_write():
    with pytest.raises(NotAllowedError) as caught:
        RIGHTS.check(caller(Role.VIEW), command("start"), PUMP)
    assert str(caught.value) == (
        'anna has the role view, and start of pump needs operate; write role = "operate" in users.toml'
    )
    with pytest.raises(NotAllowedError) as caught:
        RIGHTS.check(caller(Role.OPERATE), command("start"), replace(PUMP, network=NetworkAccess()))
    assert str(caught.value) == (
        "plant.toml does not allow start of pump over http; to allow it, add 'start' to network = { http = [...] } "
        "of this drive there"
    )
    with pytest.raises(ReadOnlyError) as caught:
        RIGHTS.check(caller(Role.OPERATE), command("start"), replace(PUMP, armed=False))
    assert str(caught.value) == "pump is read-only in plant.toml; write armed = true there"
    with pytest.raises(UsageError, match="unknown verb 'strat'; did you mean 'start'"):
        RIGHTS.check(caller(Role.OPERATE), command("strat"), PUMP)


def test_verbs_for_a_caller_depend_on_role_door_and_drive():
    own = replace(PUMP, network=NetworkAccess(verbs={"http": ("start", "reset")}))
    asking = ["read", "read_many", "polled", "polled_many", "status", "polled_status", "wait", "identify", "probe"]
    asking.append("read_watchdog")
    assert RIGHTS.verbs_for(caller(Role.OPERATE), own) == [*asking, "start", "keep", "reset", "stop"]
    assert RIGHTS.verbs_for(caller(Role.VIEW), own) == [*asking, "stop"]
    assert RIGHTS.verbs_for(caller(Role.VIEW, name=ANONYMOUS), own) == asking
    assert RIGHTS.verbs_for(caller(Role.NOBODY), own) == []
    assert RIGHTS.verbs_for(caller(Role.COMMISSION, LOCAL), own) == list(NEEDS)
    assert RIGHTS.verbs_for(caller(Role.COMMISSION), replace(PUMP, armed=False)) == [*asking, "stop"]


@given(
    role=st.sampled_from(Role),
    door=st.sampled_from([HTTP, LOCAL, "mqtt broker"]),
    armed=st.booleans(),
    verbs=st.dictionaries(st.sampled_from(["http", "mqtt"]), st.lists(st.sampled_from(NETWORK_VERBS)).map(tuple)),
    write=st.lists(st.sampled_from(["3-41", "jog"])).map(tuple),
    verb=st.sampled_from(list(NEEDS)),
)
def test_listed_verbs_are_exactly_the_allowed_ones(*, role, door, armed, verbs, write, verb):
    drive = replace(PUMP, armed=armed, network=NetworkAccess(verbs=verbs, write=write))
    who = caller(role, door)
    listed = verb in RIGHTS.verbs_for(who, drive)
    arguments = [{"parameter": "3-41"}, {"parameter": "jog"}, {"verb": "jog"}, {"verb": "3-41"}]
    able = any(may(who, command(verb, **each), drive) for each in arguments)
    only_asks = verb == "call" and door == LOCAL and not armed
    assert listed == able or (only_asks and able)
