"""Tuning: the pause that a drive needs after its replies, found in virtual time."""

import asyncio

import pytest

import drivecomm
from drivecomm.commissioning import TuningTrial, tune, tune_async
from drivecomm.errors import NoReplyError, NotSupported, UsageError
from drivecomm.link import CAREFUL_S
from drivecomm.plant import FaultPlan, LineFault, Plant, PlantLine
from drivecomm.protocol import DriveConfig, installed
from drivecomm.virtual import VirtualPlant

FAST = [("vlt3500", {}), ("fuji", {"model": "frenic"})]


class Bench:
    """Drive on a virtual line whose telegrams are recorded. needs_s: pause that the drive needs after its reply."""

    def __init__(self, protocol, options, *, needs_s=0.0, delay_s=0.002, faults=None):
        self.config = DriveConfig(
            protocol=protocol,
            address=1,
            line="line",
            options={"baudrate": 115200, **options},
            needs_pause_s=needs_s,
            reply_delay_s=delay_s,
        )
        self.plant = VirtualPlant(Plant(lines=(PlantLine(name="line"),), drives=(self.config,)))
        self.line = self.plant.line("line")
        self.line.monitors.append(self._heard)
        if faults is not None:
            self.line.faults = faults
        self.requests, self.pauses, self.trials = [], [], []
        self.ended = None

    def open(self):
        return drivecomm.open_bus(self.line.port)

    def tuned(self, *arguments, **options):
        with self.open() as bus:
            return tune(self.config.build(bus.drive), *arguments, tried=self.trials.append, **options)

    def _heard(self, sent):
        if sent.source == "drive":
            self.ended = sent.ended
            return
        self.requests.append(sent.data)
        if self.ended is not None:
            self.pauses.append(sent.began - self.ended)
        self.ended = None


@pytest.mark.parametrize(("protocol", "options"), FAST)
def test_drive_that_fails_with_its_usual_pause_gets_a_longer_one(protocol, options):
    bench = Bench(protocol, options, needs_s=0.12)
    found = bench.tuned(100)
    assert found.before.error
    assert not found.error
    assert 0.12 <= found.held_s <= 1.05 * 0.12
    assert found.options["turnaround_s"] == found.turnaround_s
    assert found.held_s < found.turnaround_s <= 0.17


@pytest.mark.parametrize(("protocol", "options"), FAST)
def test_slow_drive_gets_a_longer_reply_timeout(protocol, options):
    bench = Bench(protocol, options, delay_s=1.1)
    found = bench.tuned(20)
    assert found.before.error
    assert not found.error
    assert "turnaround_s" not in found.options
    assert 3.3 <= found.options["reply_timeout_s"] < 3.4


@pytest.mark.parametrize(("protocol", "options"), FAST)
@pytest.mark.parametrize("needs_s", [0.001, 0.003])
def test_needed_pause_is_found_and_gets_a_margin(protocol, options, needs_s):
    bench = Bench(protocol, options, needs_s=needs_s)
    found = bench.tuned()
    assert needs_s <= found.held_s <= 1.05 * needs_s
    margin_s = max(found.held_s / 3, 0.0004)
    assert found.turnaround_s == pytest.approx(found.held_s + margin_s, abs=0.00002)
    assert (found.after.exchanges, found.after.error, found.error) == (300, "", "")
    assert found.options["tuned_turnaround_s"] == found.turnaround_s
    assert found.before.turnaround_s == 0.010
    assert found.gain == pytest.approx(found.after.per_second / found.before.per_second)
    assert found.gain > 1.5
    allowed_s = 1 / found.before.per_second - 0.010 + needs_s
    assert found.after.per_second * allowed_s > 0.85
    if needs_s == 0.001:
        assert found.after.per_second * allowed_s > 0.92


@pytest.mark.parametrize(("protocol", "options"), FAST)
def test_tuned_pause_holds_and_is_as_fast_as_reported(protocol, options):
    bench = Bench(protocol, options, needs_s=0.001)
    found = bench.tuned()
    bench.line.advance(1)
    with bench.open() as bus:
        drive = bench.config.with_options(**found.options).build(bus.drive)
        drive.probe()
        bench.line.advance(CAREFUL_S)
        drive.probe()
        began = bus.now()
        for _ in range(300):
            drive.probe()
        assert 300 / (bus.now() - began) == pytest.approx(found.after.per_second)
        assert set(bus.counters[drive.name]) == {"requests", "replies"}


@pytest.mark.parametrize(
    ("protocol", "options", "least_s"),
    [
        ("vabus", {}, 0.002),
        ("vabus", {"turnaround_s": 0.02}, 0.002),
        ("fuji", {}, 0.010),
        ("fuji", {"model": "e11s"}, 0.010),
        ("danfoss-fc", {}, 22 / 115200),
        ("vlt3500", {"least_turnaround_s": 0.004}, 0.004),
        ("vlt3500", {"turnaround_characters": 10}, 100 / 115200),
    ],
)
def test_no_pause_below_the_makers_minimum_is_tried(protocol, options, least_s):
    bench = Bench(protocol, options)
    found = bench.tuned()
    assert found.least_s == pytest.approx(least_s)
    assert min(bench.pauses) >= least_s - 1e-9
    assert all(trial.turnaround_s >= least_s - 1e-9 for trial in bench.trials)
    assert found.turnaround_s >= least_s - 1e-9
    assert not found.error


def test_pause_already_below_the_makers_minimum_stays():
    found = Bench("fuji", {"turnaround_s": 0.002}).tuned()
    assert found.turnaround_s == 0.002
    assert "tuned_turnaround_s" not in found.options


@pytest.mark.parametrize(
    ("protocol", "options"), [*FAST, ("vabus", {"turnaround_s": 0.01, "model": "agile"}), ("danfoss-fc", {})]
)
def test_tuning_sends_no_write_or_command(protocol, options):
    bench = Bench(protocol, options, needs_s=0.001)
    bench.tuned(50)
    plugin = installed[protocol]
    codec = plugin.codec(plugin.options())
    for data in set(bench.requests):
        intent = plugin.intent(codec.decode(data, "request"))
        assert (intent.access, intent.commands) in {("read", False), ("", False)}, data


def test_trial_ends_at_its_first_error_and_the_usual_pause_follows():
    bench = Bench("vlt3500", {}, needs_s=0.004)
    silent = []

    def tried(trial):
        bench.trials.append(trial)
        silent.append(bus.health["vlt3500:1"].failed_calls)

    with bench.open() as bus:
        tune(bench.config.build(bus.drive), tried=tried)
        assert not bus.health["vlt3500:1"].given_up
    failed = [trial for trial in bench.trials if trial.error]
    assert len(failed) >= 2
    assert all("did not answer" in trial.error and not trial.exchanges for trial in failed)
    assert max(silent) == 1, "never two requests in a row"
    # Each lost request is followed by an answered one, so every timeout belongs to a failed trial.
    assert bus.counters["vlt3500:1"]["timeouts"] == len(failed)


@pytest.mark.parametrize("kind", [LineFault.DROP, LineFault.CORRUPT, LineFault.DUPLICATE])
@pytest.mark.parametrize("seed", range(3))
def test_line_with_errors_at_any_pause_is_not_tuned(kind, seed):
    bench = Bench("vlt3500", {}, needs_s=0.001, faults=FaultPlan(rate=0.1, seed=seed, kinds=[kind], requests=False))
    found = bench.tuned()
    assert found.error
    assert found.options == {}


@pytest.mark.parametrize("seed", range(6))
def test_rare_errors_allow_only_a_pause_that_held_for_all_exchanges(seed):
    bench = Bench("vlt3500", {}, needs_s=0.001, faults=FaultPlan(rate=0.005, seed=seed, kinds=[LineFault.DROP]))
    found = bench.tuned()
    if found.options:
        assert (found.after.exchanges, found.after.error) == (300, "")
        assert found.turnaround_s > 0.001
    else:
        assert found.error


def test_drive_that_falls_silent_ends_the_tuning():
    bench = Bench("vlt3500", {}, needs_s=0.001)
    at = []

    def die():
        bench.plant.power_off("vlt3500:1")
        at.append(len(bench.requests))

    bench.line.call_at(CAREFUL_S + 1.0, die)
    with pytest.raises(NoReplyError, match="vlt3500:1 did not answer"):
        bench.tuned()
    assert bench.trials[0].error == ""
    assert bench.trials[-1].error
    assert len(bench.requests) - at[0] <= 5, "one of the trial, and those that ask whether it is there still"


def test_silent_drive_is_not_tuned():
    bench = Bench("vlt3500", {})
    bench.plant.power_off("vlt3500:1")
    with pytest.raises(NoReplyError):
        bench.tuned()
    assert bench.trials == []


@pytest.mark.parametrize(
    ("protocol", "delay_s", "timeout_s"),
    [
        ("danfoss-fc", 0.060, 0.180),
        ("danfoss-fc", 0.010, 0.100),
        ("vlt3500", 0.002, 0.100),
        ("vlt3500", 0.040, 0.120),
        ("vabus", 0.002, 0.500),
    ],
)
def test_reply_timeout_follows_the_reply_times(protocol, delay_s, timeout_s):
    found = Bench(protocol, {}, delay_s=delay_s).tuned()
    assert found.reply_timeout_s == pytest.approx(timeout_s)
    assert found.reply_delays.longest_s == pytest.approx(delay_s)
    assert found.reply_delays.shortest_s == pytest.approx(delay_s)
    changes = found.reply_timeout_s != found.reply_timeout_before_s
    assert found.options.get("reply_timeout_s") == (found.reply_timeout_s if changes else None)


def test_tuned_drive_is_tuned_again_from_its_usual_pause():
    found = Bench("vlt3500", {"tuned_turnaround_s": 0.0005}, needs_s=0.001).tuned()
    assert found.before.turnaround_s == 0.010
    assert found.tuned_before_s == 0.0005
    assert found.options["tuned_turnaround_s"] == pytest.approx(0.00142)
    again = Bench("vlt3500", dict(found.options), needs_s=0.001).tuned()
    assert again.options == {}, "nothing changes"
    slower = Bench("vlt3500", dict(found.options), needs_s=0.0095).tuned()
    assert slower.options == {"tuned_turnaround_s": 0.0}, "it is tuned no more"


def test_other_requests_may_use_the_line_during_tuning():
    bench = Bench("vlt3500", {}, needs_s=0.001)
    with bench.open() as bus:
        other = bench.config.build(bus.drive)
        found = tune(bench.config.build(bus.drive), 50, progress=lambda *_: other.status())
    assert not found.error
    assert found.turnaround_s >= 0.001


def test_awaited_tuning_gives_the_same_result():
    bench = Bench("vlt3500", {}, needs_s=0.001)

    async def tuned():
        async with drivecomm.open_bus_async(bench.line.port) as bus:
            return await tune_async(bench.config.build(bus.drive), 50, tried=bench.trials.append)

    found = asyncio.run(tuned())
    assert found.options == Bench("vlt3500", {}, needs_s=0.001).tuned(50).options
    assert found.after.exchanges == 50


def test_too_few_exchanges_and_broadcasts_are_refused():
    bench = Bench("vlt3500", {})
    with pytest.raises(UsageError, match="19 exchanges are too few; use 20 or more"):
        bench.tuned(19)
    with bench.open() as bus, pytest.raises(NotSupported, match="tune one drive"):
        tune(bus.broadcast("vlt3500"))


def test_remaining_time_is_estimated_after_the_first_trial():
    bench = Bench("vlt3500", {}, needs_s=0.001)
    with bench.open() as bus:
        drive = bench.config.build(bus.drive)
        rests = []
        tune(drive, tried=lambda trial: rests.append((bus.now(), trial.rest_s(300, drive.facts))))
        at, rest_s = rests[0]
        assert 0.2 * rest_s < bus.now() - at < rest_s


def test_slow_master_does_not_prove_a_pause_shorter_than_its_own():
    bench = Bench("vlt3500", {}, needs_s=0.003)
    with bench.open() as bus:
        found = tune(bench.config.build(bus.drive), progress=lambda *_: bench.line.advance(0.0035))
    assert found.held_s == pytest.approx(0.0035)
    assert found.turnaround_s == pytest.approx(0.0035 * 4 / 3, abs=0.00002)


class OccasionalLoss:
    """Disturbance that drops each fiftieth request unless a longer pause precedes it."""

    def __init__(self, bench, needs_s):
        self.bench, self.needs_s, self.requests = bench, needs_s, 0

    def request(self, data, now):
        self.requests += 1
        paused_s = self.needs_s if self.bench.ended is None else now - self.bench.ended
        return [] if self.requests % 50 == 0 and paused_s < self.needs_s else [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002 - part of the interface of disturbances
        return [(0.0, data)]


def test_pause_that_fails_in_confirmation_is_doubled():
    bench = Bench("vlt3500", {}, needs_s=0.0005)
    bench.line.disturbances.append(OccasionalLoss(bench, 0.003))
    found = bench.tuned()
    assert (found.error, found.after.exchanges) == ("", 300)
    assert 0.003 <= found.turnaround_s < 0.010
    confirming = [trial for trial in bench.trials if trial.turnaround_s > found.held_s and trial.error][-1]
    assert found.turnaround_s == pytest.approx(2 * confirming.turnaround_s)


def test_rate_of_a_trial_without_exchanges_is_zero():
    assert TuningTrial(turnaround_s=0.01, pause_s=0.01, exchanges=0, seconds=0.0).per_second == 0
