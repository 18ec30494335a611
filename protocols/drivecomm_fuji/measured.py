"""What an inverter measures: the M codes, live and at the latest alarm (section 6 of the specification)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm_fuji.words import FULL_SCALE, STATUS_BITS

if TYPE_CHECKING:
    from drivecomm.motor import Motor
    from drivecomm_fuji.profiles import Profile
    from drivecomm_fuji.store import Store

_AT_ALARM = {
    "M01": "M27",
    "M05": "M31",
    "M06": "M32",
    "M07": "M33",
    "M08": "M34",
    "M09": "M35",
    "M10": "M36",
    "M11": "M37",
}
"""Which function keeps the value of which at an alarm."""

_MEMORY = ("M16", "M17", "M18", "M19")

_UNDERVOLTAGE = 10


def show_measured(
    store: Store,
    motor: Motor,
    profile: Profile,
    *,
    reference_hz: float,
    command: int,
    linked: bool,
    busy: bool,
) -> None:
    """Put what the motor does into the M codes."""
    per_hz = FULL_SCALE / motor.maximum_hz
    backwards = bool(command & 2) and not command & 1
    reference = -reference_hz if backwards else reference_hz
    for function, value in (
        ("M01", reference * per_hz),
        ("M02", motor.torque_percent),
        ("M03", motor.torque_percent),
        ("M05", abs(reference_hz)),
        ("M06", motor.output_hz * per_hz),
        ("M07", motor.torque_percent),
        ("M08", motor.torque_percent),
        ("M10", motor.power_kw / motor.rated_kw * 100),
        ("M11", motor.current_a / motor.rated_a * 100),
        ("M12", motor.voltage_v),
        ("M13", command),
        ("M14", _status(motor, profile, backwards=backwards, linked=linked, busy=busy)),
        ("M15", store.held("S07")),
        ("M20", motor.running_s // 3600),
        ("M21", motor.dc_link_v),
    ):
        store.show(function, value)
    # An inverter that never sends the sign character shows the magnitude; M14 tells the direction.
    signed = "M09" in profile.sign_functions
    store.show("M09", motor.output_hz if signed else abs(motor.output_hz), sign_character=signed)


def shift_alarms(store: Store, code: int) -> None:
    """Enter an alarm into the memory, newest first, and keep what was measured last."""
    for newer, older in zip(_MEMORY[-2::-1], _MEMORY[:0:-1], strict=True):
        store.copy(newer, older)
    store.set("M16", code)
    for live, kept in _AT_ALARM.items():
        store.copy(live, kept)


def _status(motor: Motor, profile: Profile, *, backwards: bool, linked: bool, busy: bool) -> int:
    reverse = motor.output_hz < 0 if motor.output_hz else backwards
    # On the way to the other direction the motor slows down first.
    turning = motor.output_hz * motor.target_hz < 0
    true = {
        "FWD": motor.running and not reverse,
        "REV": motor.running and reverse,
        "INT": not motor.running,
        "NUV": motor.fault != _UNDERVOLTAGE,
        "ACC": motor.accelerating and not turning,
        "DEC": motor.decelerating or (motor.running and turning),
        "ALM": bool(motor.fault),
        "RL": linked,
        "BUSY": busy,
    }
    word = sum(1 << STATUS_BITS[name] for name, state in true.items() if state)
    return word | (1 << 13 if linked and profile.name == "g11s" else 0)
