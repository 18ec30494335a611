"""Conformance of whole protocols: the built-in ones pass, and each of many mistakes is found by its check."""

from dataclasses import dataclass, replace
from decimal import Decimal

import pytest
from altered import Altered

from drivecomm.errors import UsageError
from drivecomm.profiles import control_profile
from drivecomm.protocol import Ask, Intent, Pause, Stop, VirtualReply, installed
from drivecomm.testing import FULL, QUICK, all_checks, first_failure, results, run_conformance, skipped_checks, try_out

# test_vectors and test_properties run these checks.
ELSEWHERE = ("/vectors.toml/", "/properties/")
HERE = [
    check
    for plugin in installed.working()
    for check in all_checks(plugin, QUICK)
    if not any(part in check.name for part in ELSEWHERE)
]


@pytest.mark.parametrize("check", HERE, ids=[check.name for check in HERE])
def test_check_passes_for_an_installed_protocol(check):
    check.run()


def failed(plugin, only):
    """Return the reasons of the failed checks in this part of the report, by kind."""
    found = {}
    for check in all_checks(plugin, QUICK):
        if only in check.name:
            verdict = try_out(check)
            if not verdict.passed:
                found[check.kind] = verdict.reason
    return found


def test_every_check_has_a_meaning_and_a_unique_name():
    checks = list(all_checks(installed["vabus"]))
    assert [check.name for check in checks if not check.meaning.endswith(".")] == []
    assert len({check.name for check in checks}) == len(checks)


def test_full_extent_contains_the_quick_one():
    full, quick = ({check.name for check in all_checks(installed["vabus"], extent)} for extent in (FULL, QUICK))
    assert quick < full


def test_addresses_excluded_by_the_default_options_are_found(in_place_of):
    plugin = in_place_of("vabus", addresses_of=lambda _options: range(1, 3))
    assert "has addresses" in failed(plugin, "/has addresses")


# Correlation and checks


def test_uncompared_address_is_found(in_place_of):
    real = installed["fuji"].mismatch
    plugin = in_place_of("fuji", mismatch=lambda *pair: "" if real(*pair) == "address" else real(*pair))
    assert "another drive is not believed" in failed(plugin, "/another drive")


def test_uncompared_parameter_is_found(in_place_of):
    real = installed["vabus"].mismatch
    plugin = in_place_of("vabus", mismatch=lambda *pair: "" if real(*pair) == "parameter" else real(*pair))
    assert "an answer answers its question only" in failed(plugin, "/an answer answers")


def test_accepted_telegram_of_another_protocol_is_found(in_place_of):
    plugin = in_place_of("vabus", mismatch=lambda *_: "")
    real = plugin.codec

    def codec(options):
        made = real(options)
        anything = made.decode(b"A\x06", "reply")
        return Altered(made, decode=lambda data, way: anything if way == "reply" else made.decode(data, way))

    assert "is not believed" in failed(replace(plugin, codec=codec), "/foreign traffic/fuji/is not believed")


@pytest.mark.soak
def test_virtual_drive_answering_every_request_is_found(in_place_of):
    real = installed["vlt3500"].virtual

    def virtual(address, options, model):
        made = real(address, options, model)
        return Altered(made, hear=lambda find, _: VirtualReply(data=find.data, delay_s=0.0))

    plugin = in_place_of("vlt3500", virtual=virtual)
    assert "virtual-drive" in failed(plugin, "/virtual-drive")


# Values


def altered_reading(real, change):
    def read(*values, **options):
        reading = yield from real.read(*values, **options)
        return change(reading)

    return read


@pytest.mark.soak
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda reading: replace(reading, value=abs(reading.value)), ""),
        (lambda reading: replace(reading, value=reading.value * 10), "the drive started with"),
        (lambda reading: replace(reading, unit="V"), "has the unit 'V'"),
        (lambda reading: replace(reading, name="x"), "is called 'x'"),
        (lambda reading: replace(reading, raw=7), "reads 7, the drive holds"),
    ],
    ids=["sign lost", "decimal shifted", "wrong unit", "wrong name", "wrong raw value"],
)
def test_wrong_reading_is_found(with_operations, change, reason):
    def only_numbers(reading):
        return change(reading) if isinstance(reading.value, Decimal) else reading

    plugin = with_operations("vabus", read=lambda real: altered_reading(real, only_numbers))
    found = failed(plugin, "/reads what") | failed(plugin, "/writes what")
    assert {"reads what the drive holds", "writes what was given"} & set(found)
    assert reason in " ".join(found.values())


@pytest.mark.soak
def test_write_losing_the_sign_is_found(with_operations):
    def writing(real):
        return lambda name, value, **options: real.write(name, abs(value), **options)

    plugin = with_operations("danfoss-fc", write=writing)
    assert "writes what was given" in failed(plugin, "/writes what")


def test_accepted_impossible_store_is_found(with_operations):
    def writing(real):
        def write(name, value, **options):
            options.pop("store", None)
            return real.write(name, value, **options)

        return write

    plugin = with_operations("vlt3500", write=writing)
    assert "stores nothing where it cannot" in failed(plugin, "/stores nothing")


# Commands


def test_repeated_start_is_found(with_operations):
    def insisting(real):
        def start(*, reverse=False):
            exchange = real.start(reverse=reverse)
            answer = None
            try:
                while True:
                    command = exchange.send(answer)
                    if isinstance(command, Ask):
                        command = replace(command, attempts=3)
                    answer = yield command
            except StopIteration:
                return

        return start

    for name in ("fuji", "vlt3500"):
        plugin = with_operations(name, start=insisting)
        assert set(failed(plugin, "/a st")) == {"a start is not repeated"}


@pytest.mark.parametrize(
    ("verb", "make", "kind"),
    [
        ("stop", lambda real: lambda *_: real.stop(Stop.COAST), "stops in every way"),
        ("start", lambda real: lambda **_: real.start(), "runs backwards"),
        ("start", lambda real: lambda **_: real.stop(), "runs at the reference"),
        ("set_reference_percent", lambda real: lambda it: real.set_reference_percent(-it), "runs at the reference"),
        ("status", lambda real: lambda: altered_status(real, fault=False), "tells its faults"),
        ("status", lambda real: lambda: altered_status(real, fault_code=99), "tells its faults"),
        ("status", lambda real: lambda: altered_status(real, fault_text="lunch"), "tells its faults"),
        ("status", lambda real: lambda: altered_status(real, running=True), "stops in every way"),
        ("status", lambda real: lambda: altered_status(real, actual_percent=Decimal(-50)), "runs at the reference"),
        ("status", lambda real: lambda: altered_status(real, actual_hz=Decimal(1)), "runs at the reference"),
        ("reset", lambda _: nothing, "is reset and stands"),
        ("probe", lambda real: lambda: real.stop(Stop.COAST), "asking moves nothing"),
        ("identify", lambda real: real.start, "asking moves nothing"),
    ],
)  # fmt: skip
def test_verb_with_a_wrong_effect_is_found(with_operations, verb, make, kind):
    plugin = with_operations("danfoss-fc", **{verb: make})
    assert kind in failed(plugin, f"/models/fc300/{kind}")


def altered_status(real, **changes):
    status = yield from real.status()
    return replace(status, **changes)


def nothing():
    yield Pause(seconds=0.1)


def test_doubled_reference_in_hertz_is_found(with_operations):
    plugin = with_operations("vabus", set_reference_hz=lambda real: lambda hz: real.set_reference_hz(hz * 2))
    assert "commanded to run at 10 Hz" in failed(plugin, "vabus/models/agile/runs at")["runs at the reference"]


# The contract


@dataclass(kw_only=True)
class LooseOptions:
    """Options that are not frozen."""

    baudrate: int = 9600


@pytest.mark.parametrize(
    ("fields", "kind", "reason"),
    [
        ({"title": " "}, "has all fields", "title is empty"),
        ({"facts": 3}, "has all fields", "facts is 3"),
        ({"mismatch": None}, "has all fields", "mismatch is not callable"),
        ({"scan_addresses": range(40)}, "has addresses", "a scan probes 0"),
        ({"broadcast_address": 1}, "has addresses", "the broadcast address is that of a drive"),
        ({"broadcast_address": None}, "operations are whole", "contradict each other"),
        ({"options": LooseOptions}, "has frozen options", "is not frozen"),
        ({"parameter_examples": ("?",)}, "finds its examples", "refused: "),
        ({"parameter_examples": ()}, "finds its examples", "there are no examples"),
        ({"blind_spots": lambda data, _: frozenset(range(len(data)))}, "is honest about blind spots", "called blind"),
        (
            {"control_profiles": lambda: (replace(control_profile("fuji"), stops={}),)},
            "commands soundly",
            "control profile 'fuji': it defines how to start a motor, but not how to stop it",
        ),
        ({"mismatch": lambda *_: None}, "judges every pair", "it says None"),
        ({"mismatch": lambda request, _: request.no_such}, "judges every pair", "AttributeError"),
    ],
)
def test_violated_contract_is_found(in_place_of, fields, kind, reason):
    plugin = in_place_of("vabus", **fields)
    assert reason in failed(plugin, f"/contract/{kind}")[kind]


def test_operations_sending_before_they_refuse_are_found(with_operations):
    def hasty(real):
        def read(parameter, **options):
            yield from real.probe()
            return (yield from real.read(parameter, **options))

        return read

    plugin = with_operations("vabus", read=hasty)
    assert "is sent all the same" in failed(plugin, "/contract/refuses")["refuses what cannot be"]


def test_broadcast_waiting_for_a_reply_is_found(with_operations):
    plugin = with_operations("vabus", probe=lambda _: lambda: iter([Ask(message=None)]))
    assert "probe at all drives waits" in failed(plugin, "/contract/speaks")["speaks to all without waiting"]


@pytest.mark.parametrize(
    ("fields", "kind"),
    [
        ({"package": "drivecomm.protocol.schema"}, "has a readme"),
        ({"package": "drivecomm.protocol.schema"}, "has a source for every vector"),
        ({"facts_source": "?"}, "names the source of its facts"),
        ({"options": LooseOptions}, "explains its options"),
        ({"parameter_keys": frozenset()}, "has models in order"),
        ({"forms": lambda: {"another": installed["fuji"].forms()[next(iter(installed["fuji"].forms()))]}},
         "has vectors for everything"),
    ],
)  # fmt: skip
def test_incomplete_documents_of_a_package_are_found(in_place_of, fields, kind):
    plugin = in_place_of("vabus", **fields)
    assert kind in failed(plugin, f"/documents/{kind}")


# Intent of requests

READS, WRITES, COMMANDS = (
    lambda _, intent=intent: intent for intent in (Intent(access="read"), Intent(access="write"), Intent(commands=True))
)


@pytest.mark.parametrize(
    ("fields", "kind", "reason"),
    [
        (
            {"intent": READS},
            "tells asking from acting",
            "makes the motor run, and is declared a read",
        ),
        (
            {"intent": COMMANDS},
            "tells asking from acting",
            "is sent to read, and is declared to do more",
        ),
        ({"intent": READS}, "tells what requests are for", "and is declared a read"),
        ({"intent": WRITES}, "tells what requests are for", "is sent to read a parameter"),
        ({"intent": COMMANDS}, "tells what requests are for", "and is declared a command"),
    ],
)
def test_wrong_intent_of_requests_is_found(in_place_of, fields, kind, reason):
    plugin = in_place_of("vabus", **fields)
    assert reason in failed(plugin, kind)[kind]


def test_command_declared_to_move_nothing_is_found(in_place_of):
    plugin = in_place_of("danfoss-fc", intent=lambda _: Intent())
    kind = "what only asks moves no drive"
    assert "is declared a read, and commands the motor" in failed(plugin, kind)[kind]


def test_package_without_intents_skips_their_checks(in_place_of):
    plugin = in_place_of("vabus", intent=None)
    assert not failed(plugin, "only asks") | failed(plugin, "asking from") | failed(plugin, "requests are for")


# Own rules of a virtual drive


@pytest.mark.parametrize(
    ("take", "kind", "reason"),
    [
        (
            "drivecomm_vabus.store.VabusStore.must_allow",
            "guards its limits",
            "10 := 0 is accepted, and its limits are 1 to 4",
        ),
        ("drivecomm_vabus.store.VabusStore.power_cycle", "forgets what was not stored", "written without being stored"),
    ],
)
def test_virtual_drive_without_limits_or_memory_loss_is_found(monkeypatch, take, kind, reason):
    monkeypatch.setattr(take, lambda *_: None)
    assert reason in failed(installed["vabus"], kind)[kind]


def test_virtual_drive_ignoring_the_sign_of_a_reference_is_found(monkeypatch):
    def unsigned(machine):
        percent = machine._store.number(516)
        return percent / 2 if percent > 0 else 20.0

    reference = "drivecomm_vlt3500.machine.VltMachine._reference_hz"
    monkeypatch.setattr(reference, unsigned)
    kind = "heeds the sign of a reference"
    slow = failed(installed["vlt3500"], kind)
    assert not slow, "as fast as at zero is as slow as it can"
    monkeypatch.setattr(reference, lambda machine: abs(machine._store.number(516)) / 2)
    assert "at -40 percent the motor turns forwards, 20 Hz" in failed(installed["vlt3500"], kind)[kind]


def test_line_facts_missing_in_their_source_are_found(in_place_of):
    facts = installed["vabus"].facts
    kind = "names the source of its facts"
    for settings, missing in (({"baudrate": 9600}, "9600"), ({"parity": "N"}, "7N1")):
        plugin = in_place_of("vabus", facts=replace(facts, settings=replace(facts.settings, **settings)))
        assert f"does not say {missing}" in failed(plugin, kind)[kind]


# Conformance runs


def test_run_can_be_limited_to_a_part_of_the_checks():
    report = run_conformance(installed["fuji"], QUICK, only="/documents/")
    assert report.ok
    assert len(report.passed) == 7
    assert report.left_out == skipped_checks() == ()


def test_unknown_part_raises_usage_error():
    with pytest.raises(UsageError, match="no check has 'lunch' in its name"):
        run_conformance(installed["vabus"], QUICK, only="lunch")


def test_first_failure_stops_the_run(in_place_of):
    plugin = in_place_of("vabus", title="")
    verdict = first_failure(plugin, QUICK)
    assert verdict.check.name == "vabus/contract/has all fields"
    assert next(results(plugin, QUICK)).check.name == verdict.check.name


def test_uninstalled_protocol_is_installed_only_during_the_run():
    stranger = replace(installed["vabus"], name="stranger")
    report = run_conformance(stranger, QUICK, only="/contract/has all")
    assert report.ok
    assert "stranger" not in installed


def test_protocol_with_an_installed_name_is_refused():
    with pytest.raises(UsageError, match="another protocol is installed as 'vabus'"):
        run_conformance(replace(installed["vabus"], title="another"), QUICK)
