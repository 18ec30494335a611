"""The campaign's judge finds violations in invented commands and states."""

from types import SimpleNamespace

import pytest
from invariant import Judge

STANDS = {"running": False, "output_hz": 0.0}
RUNS = {"running": True, "output_hz": 25.0}


def command(kind, began, ended, code, *, said_at=None, signalled=(), complaint="", **told):
    return SimpleNamespace(
        kind=kind,
        drive="a",
        began=began,
        ended=ended,
        code=code,
        said_at=said_at,
        signalled=signalled,
        complaint=complaint,
        told={"percent": 50, **told},
        name=f"the {kind}",
        running=ended is None,
        killed=code == -9,
        stdout="file",
        spawned=False,
    )


def failures(state, *commands, happened=(), quiet=True, holds=10.0):
    plant = SimpleNamespace(states=lambda: {"a": state}, value=lambda _: holds)
    return list(Judge(commands, happened).failures(plant, quiet=quiet))


START = command("start", 1, 2, 0)
STOP = command("stop", 3, 4, 0)
KEPT = command("keep", 1, None, None, said_at=2)


@pytest.mark.parametrize(
    ("commands", "happened"),
    [
        ((), ()),
        ((command("start", 1, 2, 2),), ()),
        ((START, STOP), ()),
        ((START, command("stop all", 3, 4, 0)), ()),
        ((START,), ((3, "power", "a"),)),
        ((command("keep", 1, 4, 0, said_at=2),), ()),
        ((command("keep", 1, 4, -9, said_at=2),), ()),
        ((KEPT, STOP), ()),
        ((command("start", 1, 2, 130, complaint="received a stop, because its start was interrupted"),), ()),
    ],
)
def test_motor_running_without_permission_is_found(commands, happened):
    assert failures(RUNS, *commands, happened=happened) == ["a runs at 25.0 Hz, and nothing lets it"]


@pytest.mark.parametrize(
    "commands",
    [
        (START,),
        (command("start", 1, 2, -9),),
        (START, command("stop", 3, 4, 3)),
        (START, command("stop", 1.5, 4, 0)),
        (STOP, command("start", 5, 6, 0)),
        (KEPT,),
    ],
)
def test_motor_running_with_permission_is_not_reported(commands):
    assert failures(RUNS, *commands, quiet=False) == []


def test_success_without_effect_is_found():
    assert failures(STANDS, START) == ["a does not run, and the start said that it started it"]
    assert failures(STANDS, START, STOP) == []
    assert failures(RUNS, START, command("reference", 3, 4, 0, percent=80)) == [
        "a runs at 25.0 Hz, and the reference set 40.0 Hz"
    ]
    assert failures(STANDS, command("write", 1, 2, 0, value=12)) == [
        "a holds 10.0, and the write said that it wrote 12"
    ]
    assert failures(STANDS, command("write", 1, 2, 3, value=12)) == []


def test_traceback_and_end_by_a_signal_are_found():
    commands = [command("read", 1, 2, 1, complaint="Traceback"), command("read", 1, 2, -11)]
    assert list(Judge(commands, ()).of_the_processes()) == ["the read shows a traceback", "the read ended with -11"]
