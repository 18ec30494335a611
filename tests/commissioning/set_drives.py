"""Virtual drives of every model of every installed protocol, with settings that somebody has changed."""

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

# Of an inverter whose rating is not known, nobody knows the scale of its currents.
OPTIONS = {"fuji": {"rating_hp": 10}}


class Case:
    """One model of one protocol."""

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
        """What a backup holds, by address of each value."""
        return [
            (address, info)
            for info in self.model.parameters.values()
            if part_of(info, self.plugin.references(self.type.options, self.model)) == "settings" and "r" in info.access
            for address in self.plugin.element_addresses(info, self.type.options)
        ]

    @property
    def can_be_set(self):
        """Whether a backup holds something that can be set, besides what a restore leaves alone unless it is named."""
        watchdog = self.model.watchdog
        left = () if watchdog is None else (watchdog.time, watchdog.action)
        return any("w" in info.access and info.address not in left for _, info in self.settings)

    @property
    def tells_its_state(self):
        """Whether it has a status; with some protocols that is up to the model."""
        by_model = ("ei-bisynch", "lecom", "ls-bus", "modbus", "toshiba", "weg")
        return self.plugin.name not in by_model or bool(self.model.control.get("status"))

    def new(self):
        """Return a drive in its factory state."""
        return self.type.new()

    def drive(self, bus):
        """Return the master's side of it."""
        return bus.drive(self.plugin.name, self.address, model=self.model, **self.options)

    def held(self, virtual):
        """Return what a drive holds, as its telegrams would carry it."""
        return {address: virtual.peek(address, 0.0) for address, _ in self.settings}

    def change(self, virtual, random, share=0.5):
        """Change some settings, as a master that stores them would; return how many took another value."""
        before = self.held(virtual)
        watchdog = self.model.watchdog
        left = () if watchdog is None else (watchdog.time, watchdog.action)
        for address, info in self.settings:
            # Those are restored only when that is said.
            if info.address not in left and random.random() < share:
                with suppress(DriveCommError):
                    self._write(virtual, address, _another(info, random))
        if share < 1 and self.held(virtual) == before:
            # A model with a handful of settings is easily missed by chance.
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
    """Return those of whose drives a backup holds something that can be set, and that tell whether the motor runs."""
    return [case for case in cases() if case.can_be_set and case.tells_its_state]


@cache
def cases_without_status():
    """Return those that can be set while nothing tells whether the motor runs."""
    return [case for case in cases() if case.can_be_set and not case.tells_its_state]


@cache
def cases():
    """Return all that have a setting to restore; what they hold never changes."""
    every = [
        Case(plugin.name, model) for plugin in installed.working() for model in model_names(plugin.package, plugin.name)
    ]
    return [case for case in every if case.settings]


def _another(info, random):
    """Return a value near the one that a parameter starts with."""
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
    # One that starts at its limit goes the other way.
    return next((each for each in (start + away, start - away) if info.allows(each)), start)
