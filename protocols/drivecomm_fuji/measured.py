"""What an inverter measures: the M codes, live and at the latest alarm (section 6 of the specification)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm_fuji.generations import TABLES
from drivecomm_fuji.words import FULL_SCALE, REVERSE, RUN, control_profile

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Motor
    from drivecomm_fuji.generations import Profile
    from drivecomm_fuji.store import Store

AT_ALARM: Mapping[str, str] = TABLES["at_alarm"]
"""Which function keeps the value of which at an alarm."""

_MEMORY = ("M16", "M17", "M18", "M19")

_UNDERVOLTAGE = 10


def measured(
    store: Store,
    motor: Motor,
    profile: Profile,
    *,
    reference_hz: Callable[[], float],
    command: Callable[[], int],
    linked: Callable[[], bool],
    busy: Callable[[], bool],
) -> dict[str, Callable[[], float]]:
    """Return what each M code that shows a measured value gets it from when it is read."""
    # An inverter that never sends the sign character shows the magnitude; M14 tells the direction.
    signed = "M09" in profile.sign_functions

    def per_hz() -> float:
        return FULL_SCALE / motor.maximum_hz

    def backwards() -> bool:
        return command() & RUN == REVERSE

    def status() -> int:
        on = linked()
        reverse = motor.output_hz < 0 if motor.output_hz else backwards()
        # On the way to the other direction the motor slows down first.
        turning = motor.output_hz * motor.target_hz < 0
        word = control_profile().word_of(
            {
                "FWD": motor.running and not reverse,
                "REV": motor.running and reverse,
                "INT": not motor.running,
                "NUV": motor.fault != _UNDERVOLTAGE,
                "ACC": motor.accelerating and not turning,
                "DEC": motor.decelerating or (motor.running and turning),
                "ALM": bool(motor.fault),
                "RL": on,
                "BUSY": busy(),
            }
        )
        return word | (1 << 13 if on and profile.name == "g11s" else 0)

    return {
        "M01": lambda: (-reference_hz() if backwards() else reference_hz()) * per_hz(),
        "M02": lambda: motor.torque_percent,
        "M03": lambda: motor.torque_percent,
        "M05": lambda: abs(reference_hz()),
        "M06": lambda: motor.output_hz * per_hz(),
        "M07": lambda: motor.torque_percent,
        "M08": lambda: motor.torque_percent,
        "M09": lambda: motor.output_hz if signed else abs(motor.output_hz),
        "M10": lambda: motor.power_kw / motor.rated_kw * 100,
        "M11": lambda: motor.current_a / motor.rated_a * 100,
        "M12": lambda: motor.voltage_v,
        "M13": command,
        "M14": status,
        "M15": lambda: store.word_of("S07"),
        "M20": lambda: motor.running_s // 3600,
        "M21": lambda: motor.dc_link_v,
    }


def shift_alarms(store: Store, code: int, latest: Mapping[str, float]) -> None:
    """Enter an alarm into the memory, newest first, and keep what was measured last."""
    for newer, older in zip(_MEMORY[-2::-1], _MEMORY[:0:-1], strict=True):
        store.keep(newer, None, older)
    store.set("M16", code)
    for live, kept in AT_ALARM.items():
        store.keep(live, latest.get(live), kept)
