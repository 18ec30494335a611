"""Alarm rules, states of a drive called pump, and alarms on a clock that the test sets."""

from decimal import Decimal

from drivecomm.protocol import DriveConfig, DriveState as State, DriveStatus, Reading
from drivecomm.server import CurrentValue, DriveSnapshot
from drivecomm.server.alarms import AlarmLimit, AlarmRule, Alarms
from drivecomm.server.alarms.alarm import Treatment

WALL_S = 1_700_000_000.0
PUMP = DriveConfig(protocol="vabus", address=1, name="pump", line="hall")


def rule(on="fault", **changes):
    return AlarmRule(**{"name": f"pump {on}", "on": on, "drives": ("pump",), **changes})


def limit(at="12.5", hysteresis="0", side="above", **changes):
    of = AlarmLimit(quantity="output_current", side=side, at=Decimal(at), hysteresis=Decimal(hysteresis))
    return rule("limit", limit=of, **changes)


def pump(fault="", *, warning=False, reachability="answers", error="", tripped=None):
    status = None
    if reachability == "answers":
        has_fault = bool(fault) if tripped is None else tripped
        state = State.FAULT if has_fault else State.READY
        status = DriveStatus(word=0, state=state, running=False, fault=has_fault, warning=warning)
    return DriveSnapshot(config=PUMP, line="hall", reachability=reachability, status=status, fault=fault, error=error)


def current(value, quality="good", cause="", unit="A"):
    reading = None
    if value is not None:
        number = Decimal(value) if isinstance(value, str) and value != "run" else value
        reading = Reading(parameter="211", value=number, raw=0, unit=unit, name="output_current")
    return CurrentValue(time_s=1.0, drive="pump", name="output_current", reading=reading, quality=quality, cause=cause)


class ClockedAlarms:
    """Alarms on a clock that the test sets. off_s: difference between the time of day and the correct time."""

    def __init__(self, *rules, run="run", **before):
        self.now_s = 1000.0
        self.off_s = 0.0
        self.rules = rules
        self.alarms = Alarms(rules, run=run, now_s=self.now_s, time_s=self.time_s, **before)

    @property
    def time_s(self):
        return WALL_S + self.now_s + self.off_s

    def at(self, seconds, seen=None):
        """Set the clock to a number of seconds after the start, and return the new alarm events.

        seen: a state or value that the alarms receive at that time; None if only time passes.
        """
        self.now_s = 1000.0 + seconds
        if isinstance(seen, DriveSnapshot):
            found = self.alarms.drive_seen(seen, self.now_s, self.time_s)
        elif seen is not None:
            found = self.alarms.value_seen(seen, self.now_s, self.time_s)
        else:
            found = self.alarms.look(self.now_s, self.time_s)
        return [each.what for each in found]

    def texts(self):
        return [alarm.text for alarm in self.alarms.standing()]

    @property
    def alarm(self):
        (alarm,) = self.alarms.standing()
        return alarm

    def acknowledge(self, by="ann"):
        return self.treat("acknowledged", by)

    def treat(self, what, by="ann", comment="", alarm=""):
        treatment = Treatment(what=what, by=by, time_s=self.time_s, comment=comment)
        return self.alarms.treat(alarm or self.alarm.id, treatment)
