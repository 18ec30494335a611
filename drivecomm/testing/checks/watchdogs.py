"""Check of the virtual drive's watchdog, for models that describe how it is set."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import policies, set_watchdog
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, raise_all

if TYPE_CHECKING:
    from drivecomm.protocol import LinkLoss, Model, Protocol
    from drivecomm.testing.bench import Bench

_WATCHDOG_S = 4
# Longer than the watchdog timeout and the motor's ramp together.
_SILENT_S = 60.0


@check("commands")
def notices_that_its_master_is_silent(plugin: Protocol, model: Model) -> None:
    """With its watchdog set, a drive runs until its master has been silent for that time, then follows its policy."""
    wrong = []
    for policy in policies(model):
        with bench(plugin, model) as on:
            # Some drives count from their last command, and would react immediately if that was long ago.
            on.drive.stop()
            set_watchdog(on.drive, policy, _WATCHDOG_S)
            on.drive.watched(None if policy == "hold" else _WATCHDOG_S)
            on.set_some_reference()
            on.drive.start()
            for _ in range(3 * _WATCHDOG_S):
                on.line.advance(_WATCHDOG_S / 4)
                on.drive.status()
            if not _does(on, "hold"):
                wrong.append(f"with {policy} it stops or trips although its master is active")
                continue
            on.line.advance(_WATCHDOG_S / 2)
            on.virtual.follow(on.line.time)
            if not _does(on, "hold"):
                wrong.append(f"with {policy} it stops or trips before its watchdog expires")
                continue
            on.line.advance(_SILENT_S)
            on.virtual.follow(on.line.time)
            if not _does(on, policy):
                motor = on.virtual.motor
                does = f"trips with {motor.fault}" if motor.fault else "runs" if motor.running else "stands"
                wrong.append(f"set to {policy} when its master falls silent, it {does}")
    raise_all(wrong)


def _does(on: Bench, policy: LinkLoss) -> bool:
    """Return whether the motor acts according to a policy."""
    motor = on.virtual.motor
    motor.advance(on.line.time)
    if policy == "trip":
        return bool(motor.fault)
    return motor.running == (policy == "hold") and not motor.fault
