"""The drive's own watchdog: the reaction of the drive itself when its master falls silent.

The drive's model names its parameters (`drivecomm.models.Watchdog`). This is not a safety function.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, TypeVar

from drivecomm.bus.call_styles import RemoteCalls
from drivecomm.bus.procedures import (
    Procedure,
    carry_out,
    carry_out_async,
    note_watchdog,
    read_parameter,
    write_parameter,
)
from drivecomm.errors import NotSupported, StateError, UnexpectedReplyError, UsageError, ValueRefusedError
from drivecomm.models import converted, link_loss_of
from drivecomm.protocol import exact

if TYPE_CHECKING:
    from drivecomm.bus.drives import AsyncDrive, Drive
    from drivecomm.protocol import LinkLoss, Model, ParameterInfo, Reading, Value, Watchdog

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Setting of a drive's watchdog.

    policy: what the motor does when the drive gets no telegram for time_s seconds; "hold" if the watchdog is off, None
    if the reaction is not one of the policies. time_s: None if the watchdog is off. action: the value of the drive's
    parameter, in the words of its model; empty if there is no such parameter. action_value, time_value: the values of
    the two parameters, as they are written.
    """

    policy: LinkLoss | None
    time_s: Decimal | None
    action: str
    action_value: Value | None
    time_value: Value

    def __str__(self) -> str:
        if self.time_s is None:
            return "off"
        what = self.action if self.policy is None else self.policy
        return f"{what} after {self.time_s} s"


def read_watchdog(drive: Drive) -> Setting:
    """Return the setting of the drive's watchdog.

    Raises UsageError for a drive without a model, NotSupported if its model has no watchdog, and the errors of
    `Drive.read`.
    """
    return carry_out(drive, reading_watchdog(drive.name, drive.model))


def set_watchdog(drive: Drive, policy: LinkLoss, time_s: Value | float = 5) -> Setting:
    """Set the drive's reaction to time_s seconds without a telegram, and return the setting that it then reports.

    Only values that differ are written, without storing them if the drive can do that, and read back. "hold" switches
    the watchdog off, and time_s is then ignored. Some drives, for example those of Danfoss, count from their last
    command, and react immediately if it is longer ago; command such a drive first, for example a stop.

    Raises NotSupported for a policy that this drive's watchdog does not have, ValueRefusedError for a time that its
    parameter cannot hold, StateError if another value is read back, UsageError for a drive of a server, whose own polls
    would feed the watchdog even after this program has died, and the errors of `read_watchdog`.
    """
    _check_feeding(drive, policy)
    return carry_out(drive, setting_watchdog(drive.name, drive.model, policy, time_s))


async def read_watchdog_async(drive: AsyncDrive) -> Setting:
    """Return the setting of the drive's watchdog, as `read_watchdog` does."""
    return await carry_out_async(drive, reading_watchdog(drive.name, drive.model))


async def set_watchdog_async(drive: AsyncDrive, policy: LinkLoss, time_s: Value | float = 5) -> Setting:
    """Set the drive's watchdog, as `set_watchdog` does."""
    _check_feeding(drive, policy)
    return await carry_out_async(drive, setting_watchdog(drive.name, drive.model, policy, time_s))


def _check_feeding(drive: object, policy: LinkLoss) -> None:
    """Raise UsageError for a watchdog that a server would feed."""
    if policy != "hold" and isinstance(drive, RemoteCalls):
        raise UsageError(
            "the watchdog of a drive on a line of a server would be fed by the server's own questions although this "
            "program had died; keep the motor with drivecomm.keep, which takes a lease, or open the plant with "
            "own_ports=True",
            says="own_ports=True",
        )


def policies(model: Model | None) -> tuple[LinkLoss, ...]:
    """Return the policies that drives of this model support; empty if they are unknown.

    A watchdog that a drive has contradicted counts as unknown.
    """
    if model is None or model.watchdog is None or model.watchdog.sure == "contradicted":
        return ()
    known = dict.fromkeys(model.watchdog.actions)
    return tuple(known if model.watchdog.off is None else {"hold": None, **known})


def reading_watchdog(name: str, model: Model | None) -> Procedure[Setting]:
    """Read the watchdog setting of the drive with this name."""
    return _noted(_reading(_Parameters(name, model)))


def setting_watchdog(name: str, model: Model | None, policy: LinkLoss, time_s: Value | float) -> Procedure[Setting]:
    """Set the watchdog to a policy, and read it back. Invalid arguments raise an error before anything is sent."""
    parameters = _Parameters(name, model)
    action, time = parameters.values_for(policy, exact(time_s, "watchdog time"))
    return _noted(_setting(parameters, action, time))


def restoring_watchdog(name: str, model: Model | None, earlier: Setting) -> Procedure[Setting]:
    """Restore an earlier setting of the watchdog."""
    return _noted(_setting(_Parameters(name, model), earlier.action_value, earlier.time_value))


def _noted(procedure: Procedure[Setting]) -> Procedure[Setting]:
    """Record how long the watchdog of the setting waits, because older commands must not be repeated."""
    setting = yield from procedure
    yield note_watchdog(None if setting.time_s is None else float(setting.time_s))
    return setting


def _reading(parameters: _Parameters) -> Procedure[Setting]:
    time = _number((yield read_parameter(parameters.time.address)))
    action, words = None, ""
    if parameters.action is not None:
        reading = yield read_parameter(parameters.action.address)
        action = _number(reading)
        words = _words(parameters.action, action)
    return parameters.setting(action, time, words)


def _setting(parameters: _Parameters, action: Value | None, time: Value | None) -> Procedure[Setting]:
    """Write the values that differ. A parameter whose value is None is left as it is."""
    now = yield from _reading(parameters)
    held = parameters.by_address(now.action_value, now.time_value)
    wanted = parameters.by_address(
        now.action_value if action is None else action, now.time_value if time is None else time
    )
    goes_off = parameters.is_off(wanted)
    # Switch the watchdog on last, or off first, so that it never acts on a half-made setting.
    order = sorted(wanted, key=lambda address: (address == parameters.switch) != goes_off)
    written = [address for address in order if wanted[address] != held[address]]
    for address in written:
        try:
            yield write_parameter(address, wanted[address], store=False)
        except NotSupported:
            # This drive stores every write.
            yield write_parameter(address, wanted[address], store=True)
    if not written:
        return now
    after = yield from _reading(parameters)
    found = parameters.by_address(after.action_value, after.time_value)
    for address in written:
        if found[address] != wanted[address]:
            raise StateError(
                f"parameter {address} of the watchdog was written with {wanted[address]} and reads {found[address]}; "
                "do not rely on the watchdog until this is corrected"
            )
    return after


class _Parameters:
    """The parameters of one drive's watchdog. Raises UsageError or NotSupported if there are none."""

    def __init__(self, name: str, model: Model | None) -> None:
        if model is None:
            raise UsageError(f"{name} has no model, so the parameters of its watchdog are unknown; give its model")
        if model.watchdog is None:
            raise NotSupported(
                f"the model {model.name} of {name} has no watchdog that can be set; if the line goes dead: "
                f'{link_loss_of(model)}; use the policy "hold" to accept that'
            )
        self._name = name
        self._watchdog: Watchdog = model.watchdog
        self.time = _info(model, self._watchdog.time)
        self.action = _info(model, self._watchdog.action) if self._watchdog.action else None
        self._known = policies(model)

    @property
    def switch(self) -> str:
        """Address of the parameter that switches the watchdog on and off."""
        if self._watchdog.off is not None or self.action is None:
            return self.time.address
        return self.action.address

    def values_for(self, policy: LinkLoss, time_s: Decimal) -> tuple[Value | None, Value | None]:
        """Return the action and the time to write for a policy; None for a parameter that is left as it is."""
        watchdog = self._watchdog
        if policy not in self._known:
            raise NotSupported(
                f"the watchdog of {self._name} ({self._shown}) cannot {policy}; it can {' or '.join(self._known)}"
            )
        if policy == "hold":
            if watchdog.off is not None:
                return None, watchdog.off * self.time.factor
            return self._action_value(policy), None
        return self._action_value(policy), self._time_value(time_s)

    def is_off(self, values: dict[str, Value]) -> bool:
        """Return whether these values, by address, switch the watchdog off."""
        watchdog = self._watchdog
        if watchdog.off is not None:
            return values[self.time.address] == watchdog.off * self.time.factor
        return self.action is not None and values.get(self.action.address) == self._action_value("hold")

    def setting(self, action: Value | None, time: Value, words: str) -> Setting:
        """Return the setting that these values stand for."""
        policy = next((each for each in self._watchdog.actions if self._action_value(each) in (None, action)), None)
        if self.is_off(self.by_address(action, time)):
            policy = "hold"
        seconds = None if policy == "hold" else converted(Decimal(time), self.time.unit or "s", "s")
        return Setting(policy=policy, time_s=seconds, action=words, action_value=action, time_value=time)

    def by_address(self, action: Value | None, time: Value) -> dict[str, Value]:
        """Return these values by the addresses of their parameters."""
        values = {self.time.address: time}
        if self.action is not None and action is not None:
            values[self.action.address] = action
        return values

    def _action_value(self, policy: LinkLoss) -> Value | None:
        if self.action is None or policy not in self._watchdog.actions:
            return None
        return self._watchdog.actions[policy] * self.action.factor

    def _time_value(self, time_s: Decimal) -> Value:
        value = converted(time_s, "s", self.time.unit or "s")
        off = self._watchdog.off
        steps = value / self.time.factor
        lowest, highest = self.time.minimum, self.time.maximum
        if (
            value <= 0
            or steps != steps.to_integral_value()
            or (off is not None and steps == off)
            or (lowest is not None and value < lowest)
            or (highest is not None and value > highest)
        ):
            raise ValueRefusedError(
                f"the watchdog of {self._name} does not support a timeout of {time_s} s: parameter "
                f"{self.time.address} counts in steps "
                f"of {self.time.factor} {self.time.unit or 's'}" + (f" up to {highest}" if highest is not None else "")
            )
        return value

    @property
    def _shown(self) -> str:
        both = (self.time, self.action)
        return "parameter " + " and ".join(each.address for each in both if each is not None)


def _info(model: Model, address: str) -> ParameterInfo:
    found = model.find(address)
    if found is None:
        raise UsageError(
            f"the watchdog of model {model.name} names {address!r}, not one of its parameters; correct the model"
        )
    return found


def _words(info: ParameterInfo, value: Decimal) -> str:
    """Return the text of an option parameter's value, in the words of the model."""
    return info.values.get(int(value / info.factor)) or f"what {info.address} = {value} means"


def _number(reading: Reading | None) -> Decimal:
    if reading is None or isinstance(reading.value, str):
        what = "nothing" if reading is None else repr(reading.value)
        raise UnexpectedReplyError(f"a parameter of the watchdog reads {what}, which is not a number")
    return Decimal(reading.value)
