"""A current value of the plant as OPC UA tells it: with a status by its quality, and the time of the reply.

Nobody shall take for current what is not: a reading in doubt is uncertain, an old one is the last usable value, and
what is not there is null. How sure the model is of a value stands in the property Note beside it; the value is good.
"""

from __future__ import annotations

from datetime import UTC
from typing import TYPE_CHECKING

from asyncua import ua

if TYPE_CHECKING:
    from drivecomm.protocol import Value
    from drivecomm.server import CurrentValue


def status(code: int) -> ua.StatusCode:
    """Return the status of a code in `ua.StatusCodes`."""
    return ua.StatusCode(ua.UInt32(code))


GOOD = status(ua.StatusCodes.Good)
UNCERTAIN = status(ua.StatusCodes.Uncertain)
LAST_USABLE = status(ua.StatusCodes.UncertainLastUsableValue)
NO_COMMUNICATION = status(ua.StatusCodes.BadNoCommunication)
NOT_CONFIGURED = status(ua.StatusCodes.BadConfigurationError)
NOT_YET = status(ua.StatusCodes.BadWaitingForInitialData)
_OTHER_TYPE = status(ua.StatusCodes.BadTypeMismatch)
NULL = ua.Variant(None, ua.VariantType.Null)

STATUS_CODES = {"good": GOOD, "uncertain": UNCERTAIN, "stale": LAST_USABLE}


def moment(time_s: float) -> ua.DateTime:
    """Return seconds since 1970 as OPC UA has them."""
    return ua.DateTime.fromtimestamp(time_s, UTC)


def now() -> ua.DateTime:
    """Return the time of day."""
    return ua.DateTime.now(UTC)


def good(value: object, kind: ua.VariantType) -> ua.DataValue:
    """Return what holds now and comes from this server."""
    time = now()
    return ua.DataValue(ua.Variant(value, kind, is_array=isinstance(value, list)), GOOD, time, time)


def waiting() -> ua.DataValue:
    """Return what a value is before its drive was asked for it."""
    return ua.DataValue(NULL, NOT_YET, None, now())


def missing(time_s: float, seen_s: float) -> ua.DataValue:
    """Return what a value is that is not there. time_s: when that was found out. seen_s: when the server took it."""
    return ua.DataValue(NULL, NO_COMMUNICATION, moment(time_s), moment(seen_s))


def told(value: Value, kind: ua.VariantType | None) -> ua.Variant | None:
    """Return a value as a variant of this type, None where it has another one; of its own type without one."""
    if isinstance(value, str):
        return ua.Variant(value, ua.VariantType.String) if kind in (None, ua.VariantType.String) else None
    if kind is ua.VariantType.String:
        return ua.Variant(str(value), ua.VariantType.String)
    return ua.Variant(float(value), ua.VariantType.Double)


def data_value(value: CurrentValue, kind: ua.VariantType | None, seen_s: float) -> ua.DataValue:
    """Return a current value.

    kind: the type of its node, None for one that may be any. seen_s: when the server took it, in seconds since 1970.
    """
    reading = value.reading
    if reading is None or value.quality == "bad":
        status = NOT_CONFIGURED if value.unreadable else NO_COMMUNICATION
        return ua.DataValue(NULL, status, moment(value.time_s), moment(seen_s))
    variant = told(reading.value, kind)
    if variant is None:
        return ua.DataValue(NULL, _OTHER_TYPE, moment(reading.time_s), moment(seen_s))
    return ua.DataValue(variant, STATUS_CODES[value.quality], moment(reading.time_s), moment(seen_s))


def too_old(last: ua.DataValue) -> ua.DataValue:
    """Return a value as it is when nothing new has come for it in time."""
    if last.StatusCode not in (GOOD, UNCERTAIN):
        return last
    return ua.DataValue(last.Value, LAST_USABLE, last.SourceTimestamp, now())


def past_value(value: Value | None, quality: str, time_s: float) -> ua.DataValue:
    """Return a value of the history; one without a value says that there was none."""
    if value is None or quality == "bad":
        return ua.DataValue(NULL, NO_COMMUNICATION, moment(time_s), None)
    return ua.DataValue(told(value, None), STATUS_CODES[quality], moment(time_s), None)
