"""Forecasts agree with the later behaviour of a line."""

from dataclasses import replace
from itertools import pairwise

import pytest

import drivecomm
from drivecomm.errors import AddressError, FileFormatError, UsageError
from drivecomm.line import PollItem, PollPlan
from drivecomm.plant import read_plant
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import VirtualLine, forecast, virtual_drive

PARAMETERS = {
    "vabus": ["480", "481", "482", "410", "411"],
    "danfoss-fc": ["16-13", "16-30", "3-41", "1-20", "16-92"],
    "vlt3500": ["215", "200", "205", "207", "216"],
    "fuji": ["M09", "M10", "F07", "S05", "M14"],
}
DRIVES = [
    ("vabus", 1, {"model": "agile"}),
    ("vabus", 2, {"model": "agile", "baudrate": 9600}),
    ("danfoss-fc", 3, {"model": "fc300"}),
    ("danfoss-fc", 4, {"model": "fc300", "baudrate": 19200}),
    ("vlt3500", 5, {"model": "vlt3500"}),
    ("vlt3500", 6, {"model": "vlt3500", "baudrate": 4800}),
    ("fuji", 7, {"model": "frenic"}),
    ("fuji", 8, {"model": "frenic", "baudrate": 19200}),
]


SERVED = """
format = 1
[[line]]
name = "hall"
port = "/dev/ttyUSB0"
[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
options = { model = "agile" }
poll = [{ parameters = ["output_frequency"] }]
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "hall"
options = { model = "fc302" }
"""


def drive(protocol="vabus", address=1, **facts):
    return DriveConfig(protocol=protocol, address=address, **facts)


def plan_of(*parameters, period_s=1.0, one=None, **facts):
    return PollPlan(
        reads=tuple(
            PollItem(drive=one or drive(), parameter=parameter, period_s=period_s, **facts) for parameter in parameters
        )
    )


def mixed_plan(period_s):
    """Return a plan of forty parameters of eight drives, in which neighbours have different line settings."""
    return PollPlan(
        reads=tuple(
            PollItem(drive=drive(protocol, address, options=options), parameter=parameter, period_s=period_s)
            for protocol, address, options in DRIVES
            for parameter in PARAMETERS[protocol]
        )
    )


def mixed_line():
    """Return the line for this plan, built without the forecast."""
    return VirtualLine([virtual_drive(protocol, address, **options) for protocol, address, options in DRIVES])


def test_forecast_of_a_mixed_line_matches_its_cycle():
    plan = mixed_plan(period_s=0.0)
    expected = forecast(plan)
    with drivecomm.open_bus(mixed_line().port) as bus:
        results = list(bus.poll(plan.items(lambda one: one.build(bus.drive)), cycles=4))
    assert {result.error for result in results} == {None}
    asked = [result.due_s + result.late_s for result in results]
    rounds = [asked[40 * number] for number in range(4)]
    for began, ended in pairwise(rounds[1:]):
        assert ended - began == pytest.approx(expected.cycle_s, rel=1e-9)
    for number, item in enumerate(expected.items):
        # An item ends with its last character, which may be sent after its result is there.
        assert asked[81 + number] - asked[80 + number] == pytest.approx(item.seconds, abs=0.002)


@pytest.mark.soak
@pytest.mark.parametrize("period_s", [1.5, 2.2])
def test_forecast_of_a_plan_with_periods_matches_its_load(period_s):
    plan = mixed_plan(period_s)
    expected = forecast(plan)
    with drivecomm.open_bus(mixed_line().port) as bus:
        results = list(bus.poll(plan.items(lambda one: one.build(bus.drive)), duration_s=8 * period_s))
    later = [result for result in results if result.due_s > 2 * period_s]
    assert expected.fits == (period_s == 2.2)
    assert expected.fits == all(not result.missed and result.late_s < period_s for result in later)
    # Each item is read once a period, or on a line that is too slow once a round.
    every = max(period_s, expected.cycle_s)
    assert len(results) == pytest.approx(40 * 8 * period_s / every, rel=0.04)
    assert expected.utilisation == pytest.approx(expected.cycle_s / period_s)


def test_forecast_of_a_read_has_wire_delay_and_pause_times():
    (item,) = forecast(plan_of("481", one=drive(options={"model": "agile"})), reply_delay_s=0.004).items
    character_s = 10 / 19200
    # Enquiry and reply of a long value, and the EOT that closes: short description, section 5.
    assert item.wire_s == pytest.approx((8 + 19 + 1) * character_s)
    assert item.delay_s == pytest.approx(0.004)
    assert item.pause_s == pytest.approx(0.002)
    assert item.rest_s == pytest.approx(0)
    assert item.seconds == pytest.approx(item.wire_s + item.delay_s + item.pause_s)


@pytest.mark.parametrize("protocol", PARAMETERS)
def test_forecast_uses_the_reply_delay_of_call_or_drive(protocol):
    def delays(**facts):
        plan = plan_of(*PARAMETERS[protocol][:2], one=drive(protocol, **facts.pop("drive", {})))
        return [item.delay_s for item in forecast(plan, **facts).items]

    assert delays(reply_delay_s=0.012) == pytest.approx([0.012, 0.012])
    assert delays(reply_delay_s=0.012, drive={"reply_delay_s": 0.003}) == pytest.approx([0.003, 0.003])
    assert all(0 < delay < 0.02 for delay in delays())


def test_forecast_uses_line_facts_of_drive_and_call():
    slow = forecast(plan_of("481", one=drive(options={"baudrate": 2400})))
    assert slow.drives[0].settings == "2400 7E1"
    assert slow.items[0].wire_s == pytest.approx(8 * forecast(plan_of("481")).items[0].wire_s)
    assert forecast(plan_of("481"), baudrate=2400) == slow
    assert forecast(plan_of("481"), turnaround_s=0.05).items[0].pause_s == pytest.approx(0.05)


def test_forecast_includes_guard_time_at_changes_of_settings():
    alternating = PollPlan(
        reads=tuple(
            PollItem(drive=drive("vabus", 1 + number % 2, options={"baudrate": 9600 * (1 + number % 2)}), parameter=p)
            for number, p in enumerate(["480", "481", "482", "483"])
        )
    )
    quick, slow = (forecast(alternating, guard_s=guard_s) for guard_s in (0.010, 0.050))
    assert slow.cycle_s - quick.cycle_s == pytest.approx(4 * 0.040)


def test_forecast_of_an_unknown_parameter_uses_the_length_of_its_type():
    plan = PollPlan(
        reads=(
            PollItem(drive=drive(), parameter="481"),
            PollItem(drive=drive(), parameter="1222", options={"type": "long"}),
            PollItem(drive=drive(), parameter="1223", options={"type": "uint"}),
        )
    )
    known, long, short = forecast(plan).items
    assert not long.cause
    assert long.wire_s == pytest.approx(known.wire_s)
    assert long.wire_s - short.wire_s == pytest.approx(4 * 10 / 19200)


def test_forecast_reports_unreadable_parameters_and_continues():
    found = forecast(plan_of("48x", "481", "1999"))
    assert found.fits
    assert [bool(item.cause) for item in found.items] == [True, False, True]
    assert found.advice == tuple(
        f"vabus:1 {item.parameter} cannot be read: {item.cause}" for item in found.items if item.cause
    )


def test_forecast_reports_a_drive_slower_than_its_reply_timeout():
    found = forecast(plan_of("481"), reply_delay_s=0.2, reply_timeout_s=0.1, attempts=2)
    (item,) = found.items
    assert "did not answer within 100 ms" in item.cause
    assert item.rest_s > 0.2


# Advice


def forecast_of_reads(number, period_s, **options):
    parameters = [str(480 + place) for place in range(number)]
    return forecast(plan_of(*parameters, period_s=period_s, one=drive(options={"model": "agile", **options})))


def test_plan_that_fits_gets_no_advice():
    found = forecast_of_reads(4, 1.0)
    assert found.fits
    assert found.advice == ()


def test_advised_period_fits():
    found = forecast_of_reads(4, 0.09)
    assert not found.fits
    assert found.utilisation > 1
    sentence = next(text for text in found.advice if text.startswith("a period of"))
    assert forecast_of_reads(4, float(sentence.split()[3])).fits
    # The advised period is not far above the one needed.
    assert float(sentence.split()[3]) < 1.15 * found.cycle_s


def test_advised_baud_rate_fits():
    found = forecast_of_reads(4, 0.15, baudrate=4800)
    assert not found.fits
    assert any(text.startswith("19200 baud for vabus:1 would fit") for text in found.advice)
    assert forecast_of_reads(4, 0.15, baudrate=19200).fits
    assert not forecast_of_reads(4, 0.15, baudrate=9600).fits


def test_advice_names_delays_and_pauses_if_no_baud_rate_suffices():
    found = forecast_of_reads(4, 0.04)
    assert any(text.startswith("no baud rate is enough: at 115200 baud") for text in found.advice)
    assert any(text.startswith("the drives' reply delays take") for text in found.advice)
    pausing = forecast(plan_of("M09", "M10", period_s=0.05, one=drive("fuji", 1)), turnaround_s=0.05)
    assert any(text.startswith("pauses take") and "fuji:1" in text for text in pausing.advice)


def test_advice_names_the_drive_that_needs_its_own_line():
    plan = PollPlan(
        reads=(
            *(PollItem(drive=drive(), parameter=p, period_s=0.1) for p in ("480", "481", "482")),
            PollItem(drive=drive(address=2), parameter="481", period_s=0.1),
        )
    )
    found = forecast(plan)
    assert not found.fits
    assert any(text.startswith("a line of its own for vabus:1 would fit") for text in found.advice)
    assert forecast(PollPlan(reads=plan.reads[:3])).fits
    assert forecast(PollPlan(reads=plan.reads[3:])).fits


def test_advice_groups_drives_by_settings():
    def reads(order):
        return PollPlan(
            reads=tuple(
                PollItem(
                    drive=drive(address=address, options={"baudrate": 9600 * (1 + address % 2)}),
                    parameter=parameter,
                    period_s=0.15,
                )
                for address, parameter in order
            )
        )

    mixed, grouped = ([1, 2, 1, 2, 1, 2], [1, 1, 1, 2, 2, 2])
    parameters = ["480", "481", "482", "483", "484", "485"]
    advice = forecast(reads(zip(mixed, parameters, strict=True)), guard_s=0.02).advice
    assert any("6 changes of settings in a round become 2, which saves 80 ms" in text for text in advice)
    advice = forecast(reads(zip(grouped, parameters, strict=True)), guard_s=0.02).advice
    assert any("the same line settings for all drives would save up to 40 ms" in text for text in advice)


def test_advice_names_a_short_period_delayed_by_a_long_read():
    slow = drive(address=2, options={"baudrate": 1200})
    plan = PollPlan(
        reads=(
            PollItem(drive=drive(), parameter="481", period_s=0.1),
            PollItem(drive=slow, parameter="481", period_s=10.0),
        )
    )
    found = forecast(plan)
    assert found.utilisation < 0.5
    assert not found.fits
    assert any(text.startswith("vabus:1 481 comes up to") for text in found.advice)


# Plans


def test_forecast_needs_a_plan_of_one_line():
    two = PollPlan(
        reads=tuple(
            PollItem(drive=drive(line=port, name=port), parameter="481", period_s=1.0) for port in ("east", "west")
        )
    )
    with pytest.raises(UsageError, match="the plan has 2 lines"):
        forecast(two)
    assert forecast(two.on_line("west")).port == "west"


def test_forecast_refuses_impossible_drives():
    with pytest.raises(AddressError, match="vabus has no drive at address 99"):
        forecast(plan_of("481", one=drive(address=99)))
    with pytest.raises(UsageError, match="no option 'colour'"):
        forecast(plan_of("481", one=drive(options={"colour": "red"})))
    with pytest.raises(UsageError, match="unknown line setting 'speed'"):
        forecast(plan_of("481"), speed=5)
    with pytest.raises(UsageError, match="invalid reply_delay_s = -1; write 0 to 60 seconds"):
        drive(reply_delay_s=-1)
    with pytest.raises(UsageError, match="two drives of the plan are named vabus:1"):
        PollPlan(reads=plan_of("481").reads + plan_of("480", one=drive(options={"baudrate": 9600})).reads)
    with pytest.raises(UsageError, match="at least one parameter"):
        PollPlan(reads=())


FILE = """
format = 1

[[line]]
name = "hall"
port = "east"

[[line]]
name = "yard"

[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
options = { model = "agile", baudrate = 9600 }
reply_delay_s = 0.005
poll = [{ parameters = ["481", "480"], period_s = 0.2, priority = 2, options = { dataset = 1 } }]

[[drive]]
drive = "fuji:7"
line = "yard"
poll = [{ parameters = ["M09"] }]
"""


def written(tmp_path, text):
    path = tmp_path / "plant.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_plant_file_gives_a_poll_plan(tmp_path):
    plan = read_plant(written(tmp_path, FILE)).poll_plan()
    pump, fan = plan.drives
    assert replace(pump, poll=()) == drive(
        name="pump", line="east", options={"model": "agile", "baudrate": 9600}, reply_delay_s=0.005
    )
    assert (fan.name, fan.line, fan.options, fan.reply_delay_s) == ("fuji:7", "", {}, None)
    first, second, third = plan.reads
    assert first == PollItem(drive=pump, parameter="481", period_s=0.2, priority=2, options={"dataset": 1})
    assert second == replace(first, parameter="480")
    assert third == PollItem(drive=fan, parameter="M09", period_s=1.0, priority=0)
    assert plan.lines == ("east", "")


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("reply_delay_s = 0.005", "reply_delay_s = -1", r"line 11: drive 1 \(pump\): invalid reply_delay_s = -1"),
        ("reply_delay_s = 0.005", "reply_delay_s = true", r"line 16: drive 1 \(pump\): invalid reply_delay_s = True"),
        ('["481", "480"]', "[]", r"drive 1 \(pump\): nothing to poll"),
        ('["481", "480"]', "[481]", r"line 17: drive 1 \(pump\), poll 1: parameters are texts"),
        ("priority = 2", "priority = 2.5", r"line 17: drive 1 \(pump\), poll 1: invalid priority = 2.5"),
        ("priority = 2", "prio = 2", r"line 17: drive 1 \(pump\), poll 1: unknown key 'prio'; did you mean 'priority'"),
        ("dataset = 1 }", "dataset = 1 }, port = 3", r"poll 1: unknown key 'port'"),
        ('"vabus:1"', '"vabus:1,model=act"', r"line 11: drive 1 \(pump\): options cannot stand after vabus:1"),
    ],
)
def test_invalid_poll_plan_in_a_plant_file_is_refused(tmp_path, before, after, message):
    assert before in FILE
    path = written(tmp_path, FILE.replace(before, after, 1))
    with pytest.raises(FileFormatError, match=message) as raised:
        read_plant(path).poll_plan()
    assert str(path) in str(raised.value)


def test_plant_file_without_polls_gives_no_plan(tmp_path):
    with pytest.raises(UsageError, match=r"nothing is polled; write poll = \[\{ parameters"):
        read_plant(written(tmp_path, 'format = 1\n[[line]]\nname = "hall"\n')).poll_plan()


def test_poll_plan_file_of_the_first_version_names_the_new_form(tmp_path):
    plan = 'format = 1\n[[drive]]\ndrive = "vabus:1"\n\n[[poll]]\ndrive = "vabus:1"\nparameters = ["481"]\n'
    with pytest.raises(
        FileFormatError, match=r"line 5: poll 1: poll plans are plant files now; write a \[\[line"
    ) as said:
        read_plant(written(tmp_path, plan))
    assert 'poll = [{ parameters = ["481"], period_s = 0.2 }]' in str(said.value)


def test_served_plan_adds_the_status_of_each_drive(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(SERVED)
    plan = read_plant(file).served_plan(0.5)
    found = forecast(plan)
    assert [(item.drive, item.parameter, item.period_s) for item in found.items] == [
        ("pump", "status", 0.5),
        ("pump", "output_frequency", 1.0),
        ("fan", "status", 0.5),
    ]
    assert not any(item.cause for item in found.items)
    line = VirtualLine([virtual_drive("vabus", 1, model="agile"), virtual_drive("danfoss-fc", 3, model="fc302")])
    with drivecomm.open_bus(line.port) as bus:
        pump, fan = bus.drive("vabus", 1, model="agile"), bus.drive("danfoss-fc", 3, model="fc302")
        for _ in range(3):
            began = line.time
            pump.status()
            pump.read("output_frequency")
            fan.status()
    assert found.cycle_s == pytest.approx(line.time - began, rel=0.03)
    assert found.utilisation > forecast(read_plant(file).poll_plan()).utilisation
