"""Commands that every door must refuse, and those it must accept, stops first; over real connections."""

import threading

import pytest
from door_clients import HANDS
from every_door import KINDS, PLANT, TOKENS, token_of, until
from mosquitto import needs_mosquitto

from drivecomm.errors import FileFormatError, PortError
from drivecomm.plant import read_plant

pytestmark = needs_mosquitto

WRONG = [(kind, wrong) for kind in KINDS for wrong in HANDS[kind].wrong]


@pytest.fixture(params=KINDS)
def hand(request, hands, at_rest):  # noqa: ARG001 - brings the plant to rest around each test
    """Yield a client of one door, with the plant at rest."""
    return hands[request.param]


def start(hand):
    """Hold the pump and start it; return the outcome."""
    assert hand.hold()
    return hand.give("start")


def test_command_is_carried_out_and_recorded(hand, at_rest):
    assert start(hand) == "done"
    until(at_rest.runs)
    assert [verb for _, drive, verb in at_rest.audit.asked_for if drive == "pump"][-1] == "keep"
    assert f"({hand.kind} " in at_rest.audit.asked_for[-1][0]
    assert hand.stop() == "done"
    until(lambda: not at_rest.runs())
    # Tokens never appear in the audit.
    assert not any(token_of(name) in str(vars(at_rest.audit)) for name in TOKENS)


def test_verb_that_the_plant_file_does_not_list_is_refused(hand, at_rest):
    assert hand.hold()
    assert hand.give("reset") == "refused"
    assert not [verb for _, _, verb in at_rest.audit.asked_for if verb == "reset"]
    until(lambda: at_rest.audit.refused_of("pump"))


@pytest.mark.parametrize("drive", ["fan", "mixer"])
def test_drive_is_commanded_only_if_armed_and_listed(hand, at_rest, drive):
    for verb in ("start", "reference"):
        assert hand.give(verb, drive) == "refused"
    assert at_rest.audit.asked_for == []
    assert not at_rest.runs(drive)
    until(lambda: at_rest.audit.refused_of(drive))


@pytest.mark.parametrize("kind", KINDS)
def test_plant_file_lists_each_verb_of_a_door_without_a_wildcard(tmp_path, kind):
    file = tmp_path / "plant.toml"
    file.write_text(PLANT.replace(f'{kind} = ["start", "reference"]', f'{kind} = ["*"]'))
    with pytest.raises(FileFormatError, match="network has no wildcard"):
        read_plant(file)


@pytest.mark.parametrize(("kind", "wrong"), WRONG, ids=[f"{kind} {wrong}".replace(" ", "-") for kind, wrong in WRONG])
def test_stale_or_undated_command_moves_no_motor(at_rest, hands, kind, wrong):
    hand = hands[kind]
    assert hand.hold()
    assert hand.give("start", **hand.wrong[wrong]) == "refused"
    if wrong in ("old", "from the future", "of an earlier run"):
        until(lambda: at_rest.audit.refused_of("pump"))
    assert not [verb for _, _, verb in at_rest.audit.asked_for if verb in ("start", "keep")]
    assert not at_rest.runs()


@pytest.mark.parametrize("kind", [kind for kind in KINDS if hasattr(HANDS[kind], "retained")])
def test_retained_command_moves_no_motor(at_rest, hands, kind):
    assert hands[kind].hold()
    assert hands[kind].retained("start") == "refused"
    assert at_rest.audit.asked_for == []
    assert at_rest.audit.refused_of("pump")


@pytest.mark.parametrize("verb", ["start", "stop"])
@pytest.mark.parametrize("kind", [kind for kind in KINDS if hasattr(HANDS[kind], "stranger")])
def test_stranger_neither_starts_nor_stops(at_rest, hands, kind, verb):
    assert hands[kind].stranger(verb) == "refused"
    assert (at_rest.audit.asked_for, at_rest.audit.stops) == ([], [])
    assert not at_rest.runs()


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not hasattr(HANDS[kind], "starts_without_a_lease")])
def test_motor_is_started_only_under_a_lease(at_rest, hands, kind):
    assert hands[kind].give("start") == "refused"
    assert not at_rest.runs()


def test_lease_of_one_door_blocks_commands_of_others_but_no_stop(hand, hands, at_rest):
    assert start(hand) == "done"
    for other in hands.values():
        if other is hand:
            continue
        assert not (other.hold() and not hasattr(other, "starts_without_a_lease")), other.kind
        for verb in ("start", "reference"):
            assert other.give(verb) == "refused", other.kind
        assert at_rest.runs(), other.kind
    for other in hands.values():
        at_rest.audit.stops.clear()
        assert other.stop() == "done", other.kind
        assert [drive for drive, _ in at_rest.audit.stops][:1] == ["pump"], other.kind
    until(lambda: not at_rest.runs())


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "opcua"])
def test_repeated_command_acts_once(at_rest, hands, kind):
    """OPC UA has no command id: its secure channel accepts no message twice."""
    hand = hands[kind]
    assert hand.hold()
    if hasattr(hand, "repeat"):
        assert hand.repeat(1) == ["done"]
        times = len(at_rest.audit.asked_for)
        outcomes = hand.repeat(3)
        # The first of these repetitions is a new command.
        assert len(at_rest.audit.asked_for) == times + 1
    else:
        outcomes = [hand.give("reference", id="the same") for _ in range(3)]
        assert len([verb for _, _, verb in at_rest.audit.asked_for if verb == "set_reference"]) == 1
    assert outcomes == ["done"] * 3


@pytest.mark.parametrize("kind", ["http", "lines", "mqtt"])
def test_repeated_start_after_a_stop_is_answered_and_moves_no_motor(at_rest, hands, kind):
    hand = hands[kind]
    assert hand.hold()
    assert hand.give("start", id="one start") == "done"
    assert hand.stop() == "done"
    until(lambda: not at_rest.runs())
    assert hand.give("start", id="one start") == "done"
    assert hand.give("reference", id="one start") == "refused"
    assert [verb for _, _, verb in at_rest.audit.asked_for] == ["keep"]
    assert not at_rest.runs()


def test_motor_is_not_restarted_after_its_drive_was_unreachable(hand, at_rest):
    assert start(hand) == "done"
    until(at_rest.runs)
    at_rest.control.order("power", drive="pump", state="off")
    until(lambda: not at_rest.answers())
    at_rest.control.order("power", drive="pump", state="on")
    at_rest.answers_for_a_while()
    assert not at_rest.runs()


def test_start_of_a_silent_drive_is_not_sent_later(hand, at_rest):
    assert hand.hold()
    at_rest.control.order("power", drive="pump", state="off")
    try:
        assert hand.give("start") in ("failed", "open", "refused")
    finally:
        at_rest.control.order("power", drive="pump", state="on")
    at_rest.answers_for_a_while()
    assert not at_rest.runs()


def test_stop_overtakes_and_cancels_a_waiting_command(hand, at_rest):
    assert hand.hold()
    outcomes = []
    with at_rest.audit.held():
        thread = threading.Thread(target=lambda: outcomes.append(hand.give("start")))
        thread.start()
        assert at_rest.audit.waiting.wait(10)
        assert hand.stop() == "done"
        assert [drive for drive, _ in at_rest.audit.stops][:1] == ["pump"]
        assert outcomes == []
    thread.join(20)
    assert outcomes
    assert outcomes != ["done"]
    assert not at_rest.runs()


def test_audit_failure_blocks_commands_but_no_stop(hand, at_rest):
    assert hand.hold()
    at_rest.audit.refuses = PortError("the audit cannot be written: no space left")
    assert hand.give("start") != "done"
    assert hand.give("reference") != "done"
    assert not at_rest.runs()
    assert hand.stop() == "done"
    assert [drive for drive, _ in at_rest.audit.stops][:1] == ["pump"]
