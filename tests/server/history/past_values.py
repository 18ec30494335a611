"""Values and events as a server has them, for tests of the history."""

from decimal import Decimal

from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue, Event

NOON = 1_795_000_000.0


def value(number=0, *, drive="pump", name="output_frequency", time_s=None, quality="good", cause="", **reading):
    """Return a value read `number` seconds after NOON; without a reading if its quality is bad."""
    time_s = NOON + number if time_s is None else time_s
    if quality == "bad":
        return CurrentValue(drive=drive, name=name, reading=None, quality="bad", cause=cause, time_s=time_s)
    given = {"parameter": "241", "value": Decimal(number).scaleb(-2), "raw": number, "unit": "Hz", "time_s": time_s}
    read = Reading(**{**given, **reading})
    return CurrentValue(drive=drive, name=name, reading=read, quality=quality, cause=cause, time_s=time_s)


def event(number, text="x", **fields):
    return Event(**{"number": number, "time_s": NOON + number, "kind": "fault", "text": text, **fields})
