"""The loops that carry out poll plans, on one and on many buses, for blocking and async callers."""

import math
from dataclasses import dataclass
from itertools import pairwise

import pytest
from benches import Port

import drivecomm
from drivecomm.errors import DriveCommError, LinkDownError, NoReplyError, UsageError
from drivecomm.line import PollItem, poll, poll_async
from drivecomm.plant import FaultPlan, LineFault
from drivecomm.protocol import Reading
from drivecomm.virtual import VirtualLine, virtual_drive


@dataclass(eq=False)
class Pump:
    name: str = "pump"


def reading(time_s=0.0, value=5):
    return Reading(parameter="1", value=value, raw=value, time_s=time_s)


@pytest.fixture
def line():
    return VirtualLine([virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3), virtual_drive("vabus", 2)])


@pytest.fixture
def bus(line):
    with drivecomm.open_bus(line.port) as opened:
        yield opened


def test_plan_on_a_bus_reads_each_item_at_its_period(bus):
    pump, fan = bus.drive("vabus", 1, model="agile"), bus.drive("danfoss-fc", 3, model="fc300")
    plan = [PollItem(drive=pump, parameter="481", period_s=0.5), PollItem(drive=fan, parameter="16-30")]
    results = list(bus.poll(plan, duration_s=3.0))
    assert [result.drive for result in results].count("vabus:1") == 6
    assert [result.drive for result in results].count("danfoss-fc:3") == 3
    assert all(result.error is None and result.late_s < 0.05 for result in results)
    # The quality of a result is that of its reading, here and in a log.
    assert {(result.drive, result.quality) for result in results} == {
        ("vabus:1", "good"),
        ("danfoss-fc:3", "good"),
    }
    assert {str(result.reading) for result in results} == {"10.00 Hz", "566 V"}
    assert all(abs(result.time_s - (result.due_s + result.late_s + result.took_s)) < 0.01 for result in results)


def test_plan_with_unreadable_parameters_is_refused_before_sending(bus, line):
    pump = bus.drive("vabus", 1, model="agile")
    fuji = bus.drive("fuji", 7, model="g11s")
    plan = [
        PollItem(drive=pump, parameter="481"),
        PollItem(drive=pump, parameter="48x"),
        PollItem(drive=pump, parameter="480", options={"dataset": 12}),
        PollItem(drive=pump, parameter="481", options={"colour": "red"}),
        PollItem(drive=fuji, parameter="output_current", name="exhaust"),
    ]
    for refuse in (bus.poll, drivecomm.poll, poll_async):
        with pytest.raises(UsageError) as raised:
            refuse(plan)
        told = str(raised.value)
        assert told.startswith("the plan has what can never be read, take it out: vabus:1 48x ('48x' is")
        assert "vabus:1 480 (data set 12 does not exist" in told
        assert "vabus:1 481 (read has no option 'colour' here" in told
        assert "exhaust output_current (model g11s does not say which parameter is the output_current" in told
        assert told.count("vabus:1 481") == 1, "what can be read is not named"
    assert line.time == 0


def test_write_only_parameter_is_not_polled(bus, tmp_path):
    model = tmp_path / "odd.toml"
    model.write_text(
        'format = 1\nname = "odd"\nprotocol = "vabus"\ntitle = "odd"\nsource = "a test"\n'
        '[[parameter]]\naddress = "481"\nname = "secret"\ntype = "long"\naccess = "w"\n'
    )
    pump = bus.drive("vabus", 1, model=model)
    pump.check_read("480")
    for name in ("481", "secret"):
        with pytest.raises(UsageError, match="481 is write-only in model odd"):
            bus.poll([PollItem(drive=pump, parameter=name)])


def test_options_of_an_item_reach_the_read(bus):
    plan = [PollItem(drive=bus.drive("vabus", 1), parameter="481", options={"type": "long"})]
    assert next(bus.poll(plan)).reading.value == 1000


def test_dead_drive_is_bad_while_the_others_are_good():
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port, attempts=1, reply_timeout_s=0.1) as bus:
        plan = [PollItem(drive=bus.drive("vabus", number, model="agile"), parameter="481") for number in (1, 2)]
        results = list(bus.poll(plan, duration_s=10.0))
    alive = [result for result in results if result.drive == "vabus:1"]
    dead = [result for result in results if result.drive == "vabus:2"]
    assert len(alive) == 10
    assert {result.quality for result in alive} == {"good"}
    assert {result.quality for result in dead} == {"bad"}
    assert all(isinstance(result.error, NoReplyError) for result in dead)


def test_lost_replies_make_values_stale_and_later_good_again():
    faults = FaultPlan(rate=0.3, seed=5, kinds=[LineFault.DROP])
    line = VirtualLine([virtual_drive("vabus", 1)], faults=faults)
    with drivecomm.open_bus(line.port, attempts=1, reply_timeout_s=0.1) as bus:
        drive = bus.drive("vabus", 1, model="agile")
        results = list(bus.poll([PollItem(drive=drive, parameter="481", period_s=3.0)], duration_s=150.0))
    stale = [result for result in results if result.quality == "stale"]
    assert stale
    assert all(result.reading.value == 10 and result.cause for result in stale)
    turns = [(before.quality, after.quality) for before, after in pairwise(results)]
    assert ("good", "stale") in turns
    assert ("stale", "good") in turns


def test_plan_with_a_drive_of_another_bus_is_refused(bus):
    with (
        drivecomm.open_bus(VirtualLine([virtual_drive("vabus", 1)]).port) as other,
        pytest.raises(UsageError, match=r"vabus:1 is not on this bus"),
    ):
        bus.poll([PollItem(drive=other.drive("vabus", 1), parameter="481")])


@pytest.mark.parametrize("seconds", [0, -1, math.nan])
def test_impossible_poll_duration_is_refused(bus, seconds):
    with pytest.raises(UsageError, match="invalid poll duration of"):
        bus.poll([PollItem(drive=bus.drive("vabus", 1), parameter="481")], duration_s=seconds)


class Plug:
    """A port that can be unplugged while its clock continues."""

    def __init__(self, line):
        self._line, self.pulled, self.tries = line, False, []

    def open(self):
        self._try()
        return Port(self._line.port(), write=self._try)

    def _try(self, *_):
        if self.pulled:
            self.tries.append(self._line.time)
            raise LinkDownError("the adapter is gone")


def test_dead_line_makes_bad_results_and_is_retried(line):
    plug = Plug(line)
    with drivecomm.open_bus(plug.open) as bus:
        plan = [
            PollItem(
                drive=bus.drive("vabus", number, model="agile"), parameter=parameter, period_s=0.1, stale_after_s=0
            )
            for number, parameter in ((1, "481"), (1, "480"), (2, "481"))
        ]
        seen = []
        for result in bus.poll(plan, duration_s=10.0):
            seen.append(result)
            plug.pulled = 2.0 < bus.now() < 7.0
    down = [result for result in seen if 2.2 < result.due_s < 6.9]
    up = [result for result in seen if not 2.0 < result.due_s < 9.1]
    assert {result.quality for result in down} == {"bad"}
    assert {type(result.error) for result in down} == {LinkDownError}
    assert {result.drive for result in down} == {"vabus:1", "vabus:2"}
    assert {result.quality for result in up} == {"good"}
    assert 4 <= len(plug.tries) <= 7
    assert all(later - earlier >= 0.5 for earlier, later in pairwise(plug.tries))


def test_failed_result_has_the_time_of_its_failure(line):
    plug = Plug(line)
    with drivecomm.open_bus(plug.open) as bus:
        drive = bus.drive("vabus", 1, model="agile")
        plan = [PollItem(drive=drive, parameter=name, period_s=0.5) for name in ("480", "481")]
        results = []
        for result in bus.poll(plan, duration_s=10.0):
            results.append(result)
            plug.pulled = bus.now() > 2.0
    failed = [result for result in results if result.error]
    assert {result.quality for result in failed} == {"stale", "bad"}
    for result in results:
        assert result.time_s == pytest.approx(result.due_s + result.late_s + result.took_s, abs=0.01)
    assert failed[0].reading.time_s < 2.1, "a stale value's own time is that of its reading"
    assert len({(result.time_s, result.parameter) for result in results}) == len(results) == 40


def test_abandoned_plan_never_sleeps_long():
    class Patient(Pump):
        """A pump that is its own bus, and records the sleeps of the loop."""

        def __init__(self):
            self.time, self.naps = 0.0, []

        @property
        def bus(self):
            return self

        def check_read(self, parameter):
            pass

        def now(self):
            return self.time

        wall_time = now

        def sleep_until(self, until):
            self.naps.append(until - self.time)
            self.time = until

        def polled(self, _):
            return reading(self.time)

    patient = Patient()
    assert len(list(poll([PollItem(drive=patient, parameter="481", period_s=5.0)], cycles=2))) == 2
    assert sum(patient.naps) == pytest.approx(5.0)
    assert max(patient.naps) < 0.1001


def test_poll_loops_raise_all_errors_that_are_not_of_drivecomm():
    class Broken(Pump):
        @property
        def bus(self):
            return self

        def now(self):
            return 0.0

        wall_time = now

        def check_read(self, parameter):
            pass

        def polled(self, parameter):
            raise RuntimeError(parameter)

    assert not issubclass(RuntimeError, DriveCommError)
    with pytest.raises(RuntimeError, match="481"):
        next(poll([PollItem(drive=Broken(), parameter="481")]))
