"""A plant of virtual drives on virtual lines, in virtual time or served.

    plant = VirtualPlant(read_plant(Path("plant.toml")))
    with drivecomm.open_bus(plant.line("hall").port) as bus:
        ...
        plant.trip("pump", 5)

Each line has its own clock, which advances while its master waits; served lines all follow the real clock.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.errors import DriveCommError, UsageError, counted
from drivecomm.models import load_model
from drivecomm.plant import UNDISTURBED, InjectStep, PowerCutStep, StuckStep, TelegramFault, TripStep
from drivecomm.protocol import Model, installed
from drivecomm.virtual.line import VirtualLine
from drivecomm.virtual.line_trace import LineTrace
from drivecomm.virtual.plant_drive import PlantDrive
from drivecomm.virtual.plant_faults import ConditionWatch, TelegramDisturbance
from drivecomm.virtual.violation_log import ViolationLog

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.plant import Plant, PlantLine, ScriptStep
    from drivecomm.protocol import DriveConfig, VirtualDrive
    from drivecomm.virtual.line_rules import LineRules

LARGEST_SPEED = 1000.0


class MotorSnapshot(NamedTuple):
    """The present state of a virtual drive. output_hz: output frequency of its motor. fault: its code, 0 for none."""

    name: str
    drive: str
    line: str
    powered: bool
    running: bool
    output_hz: float
    fault: int


class VirtualPlant:
    """The lines and drives of a plant, with its script of faults running.

    speed: seconds of the process per second of the line, 1 to 1000: motors and script run faster, the wire and
    everything on it keep their pace. around: receives each drive's name and the protocol's virtual drive, and returns a
    replacement, for example one that watches it. Raises UsageError for invalid entries, with the name of the entry.
    """

    def __init__(
        self,
        plant: Plant,
        *,
        speed: float = 1.0,
        around: Callable[[str, VirtualDrive], VirtualDrive] = lambda _, drive: drive,
    ) -> None:
        if not 1 <= speed <= LARGEST_SPEED:
            raise UsageError(f"a speed of {speed:g} is invalid; write a number from 1 to {LARGEST_SPEED:g}")
        self.plant = plant
        self.speed = speed
        self._around = around
        self.drives: Mapping[str, PlantDrive] = self._planted()
        self.lines: Mapping[str, VirtualLine] = {line.name: self._line_of(line) for line in plant.lines}
        self._traces: dict[str, LineTrace] = {}
        self.disturbances: list[TelegramDisturbance] = []
        for number, step in enumerate(plant.script, start=1):
            try:
                self.add(step)
            except DriveCommError as error:
                raise UsageError(f"fault {number}: {error}") from error

    def __repr__(self) -> str:
        there = f"{counted(len(self.drives), 'drive')} on {counted(len(self.lines), 'line')}"
        return f"<{type(self).__name__} {self.plant.file}, {there}>"

    def line(self, name: str) -> VirtualLine:
        """Return a line by its name; its `port` opens the master's end. Raises UsageError."""
        return self.lines[self.plant.line(name).name]

    def drive(self, name: str) -> PlantDrive:
        """Return a drive by its name. Raises UsageError."""
        return self.drives[self.plant.drive(name).name]

    def line_of(self, drive: str) -> VirtualLine:
        """Return the line of a drive. Raises UsageError."""
        return self.lines[self.drive(drive).planned.line]

    def rules_on(self, line: str) -> list[LineRules]:
        """Return the rules that a master must keep with each drive of a line. Raises UsageError."""
        return [self.drives[planned.name].rules for planned in self.plant.on_line(self.plant.line(line).name)]

    def watch(self, *, tolerance_s: float = 0.0) -> Mapping[str, LineTrace]:
        """Trace each line and check its master, from the first call on; return the traces by line.

        tolerance_s: largest delay of the lines' times, if they are served.
        """
        if not self._traces:
            for name, line in self.lines.items():
                log = ViolationLog(line, self.rules_on(name), tolerance_s=tolerance_s)
                self._traces[name] = LineTrace(line, log)
        return self._traces

    # Controlling the plant

    def trip(self, drive: str, code: int) -> None:
        """Make a drive trip with this fault code. Raises UsageError."""
        now = self.line_of(drive).time
        self.drive(drive).trip(TripStep(drive=drive, code=code, at_s=now).code, now)

    def power_off(self, drive: str) -> None:
        """Switch a drive off; do nothing if it is off. Raises UsageError."""
        line, planted = self.line_of(drive), self.drive(drive)
        if line.has_power(planted):
            line.power_off(planted)

    def power_on(self, drive: str) -> None:
        """Switch a drive on; do nothing if it is on. Raises UsageError."""
        line, planted = self.line_of(drive), self.drive(drive)
        if not line.has_power(planted):
            line.power_on(planted)

    def power_on_as_new(self, drive: str) -> None:
        """Switch a drive off and on again with its factory settings. Raises UsageError."""
        line, planted = self.line_of(drive), self.drive(drive)
        self.power_off(drive)
        planted.restore_factory_settings(line.time)
        line.power_on(planted)

    def set(self, drive: str, parameter: str, raw: int | str) -> None:
        """Set the raw value of a drive's parameter, as if at its keypad. Raises UsageError."""
        self.drive(drive).poke(parameter, raw)

    def get(self, drive: str, parameter: str) -> int | str:
        """Return the raw value of a drive's parameter. Raises UsageError."""
        return self.drive(drive).peek(parameter, self.line_of(drive).time)

    def inject(self, line: str, data: bytes) -> None:
        """Inject foreign bytes into a line. Raises UsageError."""
        if not data:
            raise UsageError("no bytes to inject")
        self.line(line).inject(data)

    def add(self, step: ScriptStep) -> None:
        """Add a step to the script; an action in the past happens immediately. Raises UsageError."""
        if isinstance(step, TelegramFault):
            self._disturb(step)
        elif isinstance(step, PowerCutStep):
            back = self.power_on_as_new if step.factory else self.power_on
            self._at(step.drive, step.off_at_s, partial(self.power_off, step.drive))
            if step.back_at_s is not None:
                self._at(step.drive, step.back_at_s, partial(back, step.drive))
        elif isinstance(step, TripStep):
            self._trip_later(step)
        elif isinstance(step, StuckStep):
            stuck = self.drive(step.drive).stick(step.parameter, step.value)
            self._at(step.drive, step.window.from_s, partial(self.drive(step.drive).begin, stuck))
            if step.window.until_s < float("inf"):
                self._at(step.drive, step.window.until_s, partial(self.drive(step.drive).end, step.parameter))
        elif isinstance(step, InjectStep):
            self.line(step.line).call_at(step.at_s / self.speed, partial(self.inject, step.line, step.data))

    def states(self) -> list[MotorSnapshot]:
        """Return the present state of each drive."""
        return [self._state(drive) for drive in self.drives.values()]

    def _state(self, drive: PlantDrive) -> MotorSnapshot:
        line, motor = self.line_of(drive.name), drive.motor
        if line.has_power(drive):
            drive.follow(line.time)
        motor.advance(line.time * self.speed)
        return MotorSnapshot(
            name=drive.name,
            drive=f"{drive.planned.protocol}:{drive.address}",
            line=drive.planned.line,
            powered=line.has_power(drive),
            running=motor.running,
            output_hz=round(motor.output_hz, 2),
            fault=motor.fault,
        )

    def _planted(self) -> dict[str, PlantDrive]:
        drives = {}
        settings = {line.name: line.settings for line in self.plant.lines}
        for planned in self.plant.drives:
            try:
                drives[planned.name] = PlantDrive(
                    planned, _model_of(planned), for_all=settings[planned.line], speed=self.speed, around=self._around
                )
            except DriveCommError as error:
                raise UsageError(f"drive {planned.name}: {error}") from error
        return drives

    def _line_of(self, line: PlantLine) -> VirtualLine:
        return VirtualLine(
            [self.drives[planned.name] for planned in self.plant.on_line(line.name)],
            echo=line.echo,
            faults=UNDISTURBED if line.noise is None else line.noise.plan(),
            paced=line.paced,
        )

    def _at(self, drive: str, time_s: float, action: partial[None]) -> None:
        """Schedule an action at a time of the process, on the clock of the drive's line."""
        self.line_of(drive).call_at(time_s / self.speed, action)

    def _disturb(self, fault: TelegramFault) -> None:
        line = self.line_of(fault.drive) if fault.drive else self.line(fault.line)
        if fault.of is not None and fault.of.startswith("reply to"):
            for drive in [self.drive(fault.drive)] if fault.drive else self.drives.values():
                if self.line_of(drive.name) is line and drive.type.plugin.intent is None:
                    raise UsageError(
                        f"the package of {drive.planned.protocol} does not distinguish reading from writing; "
                        'write of = "reply", and to = { } with the fields of the request'
                    )
        disturbance = TelegramDisturbance(fault, self.speed)
        self.disturbances.append(disturbance)
        line.disturbances.append(disturbance)

    def _trip_later(self, step: TripStep) -> None:
        if step.at_s is not None:
            self._at(step.drive, step.at_s, partial(self.trip, step.drive, step.code))
        if step.when is not None:
            ConditionWatch(self.line_of(step.drive), self.drive(step.drive), step.when, step.code, speed=self.speed)


def _model_of(planned: DriveConfig) -> Model:
    plugin = installed[planned.protocol]
    return load_model(plugin.package, plugin.name, planned.options.get("model", plugin.default_model))
