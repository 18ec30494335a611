"""Virtual drives of every model of every installed protocol, with changed settings."""

import string
from contextlib import suppress
from decimal import Decimal
from functools import cache

from addresses import address_of

from drivecomm.commissioning.parameter_sets import part_of
from drivecomm.errors import DriveCommError, NotSupported
from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed
from drivecomm.virtual import carry_out, drive_type

# The scale of an inverter's currents depends on its rating.
OPTIONS = {"fuji": {"rating_hp": 10}}


class Case:
    """A model of a protocol, with its virtual drive."""

    def __init__(self, protocol, model):
        self.plugin = installed[protocol]
        self.model = load_model(self.plugin.package, protocol, model)
        self.options = OPTIONS.get(protocol, {})
        self.address = address_of(protocol)
        self.type = drive_type(protocol, self.address, model=self.model, options=self.options)
        self.operations = self.plugin.operations(self.address, self.type.options, self.model)
        self.codec = self.plugin.codec(self.type.options)

    def __repr__(self):
        return f"{self.plugin.name}/{self.model.name}"

    @property
    def settings(self):
        """Address and parameter facts of each value that a backup holds."""
        return [
            (address, info)
            for info in self.model.parameters.values()
            if part_of(info, self.plugin.references(self.type.options, self.model)) == "settings" and "r" in info.access
            for address in self.plugin.element_addresses(info, self.type.options)
        ]

    @property
    def can_be_set(self):
        """Whether a backup holds a writable value that a restore writes without being asked for it by name."""
        watchdog = self.model.watchdog
        left = () if watchdog is None else (watchdog.time, watchdog.action)
        return any("w" in info.access and info.address not in left for _, info in self.settings)

    @property
    def tells_its_state(self):
        """Whether the drive has a status; with some protocols that depends on the model."""
        by_model = ("ei-bisynch", "lecom", "ls-bus", "modbus", "toshiba", "weg")
        return self.plugin.name not in by_model or bool(self.model.control.get("status"))

    def new(self):
        """Return a drive in its factory state."""
        return self.type.new()

    def drive(self, bus):
        """Return the master's drive object on the bus."""
        return bus.drive(self.plugin.name, self.address, model=self.model, **self.options)

    def held(self, virtual):
        """Return the raw values that the virtual drive holds, by address."""
        return {address: virtual.peek(address, 0.0) for address, _ in self.settings}

    def change(self, virtual, random, share=0.5):
        """Change some settings as a master does with stored writes; return how many values differ afterwards."""
        before = self.held(virtual)
        watchdog = self.model.watchdog
        left = () if watchdog is None else (watchdog.time, watchdog.action)
        for address, info in self.settings:
            # A restore writes the watchdog parameters only if they are named.
            if info.address not in left and random.random() < share:
                with suppress(DriveCommError):
                    self._write(virtual, address, _another(info, random))
        if share < 1 and self.held(virtual) == before:
            # With only a few settings, chance may pick none of them.
            return self.change(virtual, random, 1)
        return sum(value != before[address] for address, value in self.held(virtual).items())

    def _write(self, virtual, address, value):
        try:
            exchange = self.operations.write(address, value, store=True)
        except NotSupported:
            exchange = self.operations.write(address, value)
        carry_out(exchange, virtual, self.codec, 0.0)


@cache
def cases_with_settings():
    """Return the cases with a restorable setting whose drives report whether the motor runs."""
    return [case for case in cases() if case.can_be_set and case.tells_its_state]


@cache
def cases_without_status():
    """Return the cases with a restorable setting whose drives do not report whether the motor runs."""
    return [case for case in cases() if case.can_be_set and not case.tells_its_state]


@cache
def cases():
    """Return all cases whose backup holds a setting. The cases are shared, so do not change them."""
    every = [
        Case(plugin.name, model) for plugin in installed.working() for model in model_names(plugin.package, plugin.name)
    ]
    return [case for case in every if case.settings]


def _another(info, random):
    """Return a value near the start value of the parameter."""
    if info.type in ("text", "string"):
        return "".join(random.choices(string.ascii_uppercase + " ", k=random.randint(1, 12))).strip() or "X"
    start = info.start if isinstance(info.start, Decimal) else Decimal(0)
    if info.values:
        others = [each for each in info.values if each * info.factor != start]
        return random.choice(others or list(info.values)) * info.factor
    step = max(
        info.factor if info.factor != 1 else Decimal((0, (1,), int(start.as_tuple().exponent))), Decimal("0.0001")
    )
    away = step * random.choice((-1, 1)) * random.randint(1, 20)
    # A start value at its limit can only move the other way.
    return next((each for each in (start + away, start - away) if info.allows(each)), start)
