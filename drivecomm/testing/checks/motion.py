"""Checks of commands: the effect of the master's verbs on the virtual drive's motor."""

from __future__ import annotations

from decimal import Decimal
from functools import partial
from math import isclose
from typing import TYPE_CHECKING

from drivecomm.errors import DriveError, NotSupported, UsageError
from drivecomm.protocol import DriveState, MotorCommand, Stop
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import CheckFailure, check, expect, raise_all

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import DriveStatus, Model, Protocol
    from drivecomm.testing.bench import Bench

# The coarsest known step of a reference is 0.01 Hz, or a 16384th of the range.
_NEAR_HZ = 0.05

_STOPPING = {
    Stop.RAMP: MotorCommand.RAMP_STOP,
    Stop.COAST: MotorCommand.OFF,
    Stop.QUICK: MotorCommand.QUICK_STOP,
    Stop.DC_BRAKE: MotorCommand.DC_BRAKE,
}


@check("commands")
def runs_at_the_reference(plugin: Protocol, model: Model) -> None:
    """After set_reference and start the motor turns at the reference, and the status reports it."""
    with bench(plugin, model) as on:
        able = on.drive.capabilities
    if able.reference_hz:
        for hz in (10, Decimal("22.5")):
            with bench(plugin, model) as on:
                on.drive.set_reference(hz=hz)
                _started(on)
                found = on.virtual.motor.output_hz
                expect(isclose(found, hz, abs_tol=_NEAR_HZ), f"commanded to run at {hz} Hz, it runs at {found:g} Hz")
                _agrees(on.drive.status(), on)
    if able.reference_percent:
        found_at = {}
        for percent in (5, 10, 20):
            with bench(plugin, model) as on:
                on.drive.set_reference(percent=percent)
                _started(on)
                found_at[percent] = on.virtual.motor.output_hz
                status = on.drive.status()
                _agrees(status, on)
                told = status.actual_percent
                expect(told is None or abs(told - percent) < Decimal("0.2"), f"at {percent} % it reports {told} %")
        expect(
            found_at[10] > found_at[5]
            and isclose(found_at[20] - found_at[10], 2 * (found_at[10] - found_at[5]), abs_tol=2 * _NEAR_HZ),
            f"at 5, 10 and 20 % it runs at {', '.join(f'{each:g}' for each in found_at.values())} Hz",
        )


@check("commands")
def runs_backwards(plugin: Protocol, model: Model) -> None:
    """A start in reverse turns the motor backwards, or is refused before anything is sent."""
    with bench(plugin, model) as on:
        if not on.drive.capabilities.reverse:
            _refused(on, lambda: on.drive.start(reverse=True), "starting backwards")
            return
        on.set_some_reference()
        on.drive.start(reverse=True)
        on.settle()
        found = on.virtual.motor.output_hz
        expect(found < 0, f"started backwards, the motor turns at {found:g} Hz")
        status = on.drive.status()
        expect(status.reverse is not False, "the motor turns backwards, and the status reports that it does not")
        _agrees(status, on)


@check("commands")
def stops_in_every_way(plugin: Protocol, model: Model) -> None:
    """Each supported way of stopping has the effect of its name; others are refused before anything is sent."""
    wrong = []
    for how in Stop:
        with bench(plugin, model) as on:
            if how not in on.drive.capabilities.stops:
                _refused(on, partial(on.drive.stop, how), f"stopping by {how.value}")
                continue
            on.set_some_reference()
            _started(on)
            on.drive.stop(how)
            found = on.virtual.motor.command
            if found is not _STOPPING[how]:
                wrong.append(f"after a stop by {how.value}, the motor's command is {found.value}")
            on.settle()
            status = on.drive.status()
            if on.virtual.motor.running or status.running or status.state is DriveState.RUNNING:
                wrong.append(f"long after a stop by {how.value} it still runs")
    raise_all(wrong)


@check("commands")
def tells_its_faults(plugin: Protocol, model: Model) -> None:
    """A tripped drive reports the fault, with the right code and the model's text for it.

    A drive whose capabilities exclude faults must at least not report that it is running.
    """
    wrong = []
    for code in list(model.faults) or [1, 4]:
        with bench(plugin, model) as on:
            if not on.drive.capabilities.faults:
                on.set_some_reference()
                _started(on)
                on.virtual.trip(code, on.line.time)
                on.line.advance(1.0)
                expect(not on.drive.status().running, f"tripped with {code}, it is reported as running")
                continue
            expect(not on.drive.status().fault, "a drive that has not tripped reports a fault")
            on.virtual.trip(code, on.line.time)
            on.line.advance(1.0)
            status = on.drive.status()
            if not status.fault or status.state is not DriveState.FAULT or status.running:
                wrong.append(f"tripped with {code}, it reports {status.state.value}")
            elif status.fault_code not in (code, None):
                wrong.append(f"tripped with {code}, it reports fault {status.fault_code}")
            elif status.fault_code == code and status.fault_text != model.faults.get(code, status.fault_text):
                wrong.append(f"fault {code} is {status.fault_text!r}, the model says {model.faults[code]!r}")
    raise_all(wrong)


@check("commands")
def is_reset_and_stands(plugin: Protocol, model: Model) -> None:
    """A tripped drive refuses to start; a reset clears the fault and does not move the motor.

    The reset is refused if the capabilities exclude faults, or if the model has no reset.
    """
    with bench(plugin, model) as on:
        on.set_some_reference()
        _started(on)
        on.virtual.trip(next(iter(model.faults), 4), on.line.time)
        on.line.advance(1.0)
        try:
            on.drive.start()
        except DriveError:
            pass
        else:
            raise CheckFailure("a start of a tripped drive is reported as done")
        on.settle()
        if not on.drive.capabilities.faults:
            on.virtual.heard.clear()
            _refused(on, on.drive.reset, "a reset")
            return
        on.virtual.heard.clear()
        try:
            on.drive.reset()
        except NotSupported:
            on.expect_nothing_sent("a reset is refused")
            return
        on.settle()
        expect(not on.drive.status().fault and not on.virtual.motor.fault, "after the reset there is still a fault")
        expect(not on.virtual.motor.running, "after the reset the motor runs")


@check("commands")
def asking_moves_nothing(plugin: Protocol, model: Model) -> None:
    """Reading, status, probe and identify do not start or stop a motor or change its speed."""
    for running in (False, True):
        with bench(plugin, model) as on:
            if running:
                on.set_some_reference()
                _started(on)
            before = _commanded(on)
            asking: list[Callable[[], object]] = [on.drive.status, on.drive.probe, on.drive.identify]
            asking += [partial(on.drive.read, parameter) for parameter in list(model.parameters)[:40]]
            for ask in asking:
                try:
                    ask()
                except (DriveError, NotSupported):
                    continue
                on.line.advance(1.0)
                after = _commanded(on)
                expect(after == before, f"a read changes the motor from {before} to {after}")
            on.settle()
            expect(_commanded(on) == before, "a read changes the motor later")


@check("commands")
def does_not_repeat_an_old_command(plugin: Protocol, model: Model) -> None:
    """After another program has stopped the drive, setting the reference does not start it again."""
    with bench(plugin, model) as on:
        on.set_some_reference()
        _started(on)
        on.bus.drive(plugin.name, on.virtual.address, model=model).stop()
        on.settle()
        expect(not on.virtual.motor.running, "stopped by another object for the same drive, it still runs")
        on.set_some_reference()
        on.settle()
        expect(not on.virtual.motor.running, "a reference starts a drive that another program has stopped")


def _commanded(on: Bench) -> tuple[object, ...]:
    motor = on.virtual.motor
    return motor.command, motor.target_hz, motor.fault


def _started(on: Bench) -> None:
    on.drive.start()
    expect(on.virtual.motor.running, "started, the motor does not run")
    on.settle()


def _agrees(status: DriveStatus, on: Bench) -> None:
    """Raise CheckFailure if a status contradicts a motor that runs at its reference."""
    motor = on.virtual.motor
    expect(status.running and status.state is DriveState.RUNNING, f"the motor runs, and the status is {status.state}")
    expect(not status.fault, "the motor runs, and the status reports a fault")
    expect(status.at_reference is not False, "the motor is at its reference, and the status reports that it is not")
    backwards = motor.output_hz < 0
    expect(status.reverse in (None, backwards), f"the motor turns at {motor.output_hz:g} Hz, reverse {status.reverse}")
    told = status.actual_hz
    expect(
        told is None or isclose(abs(told), abs(motor.output_hz), abs_tol=_NEAR_HZ),
        f"the motor turns at {motor.output_hz:g} Hz, the status reports {told} Hz",
    )


def _refused(on: Bench, call: Callable[[], object], what: str) -> None:
    try:
        call()
    except NotSupported:
        on.expect_nothing_sent(f"{what} is refused")
    except UsageError as error:
        raise CheckFailure(f"{what} is refused by {type(error).__name__}, not by NotSupported") from error
    else:
        raise CheckFailure(f"{what} is not among the capabilities, and is not refused")
