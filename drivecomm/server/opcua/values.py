"""Current values as OPC UA data values, with a status for the quality and the time of the reply.

A value that is not current must not look current: a doubtful reading is uncertain, an old one is the last usable value,
and a missing one is null. Doubts of the model are in the property Note; the value itself is then good.
"""

from __future__ import annotations

from datetime import UTC
from typing import TYPE_CHECKING

from asyncua import ua

if TYPE_CHECKING:
    from drivecomm.protocol import Value
    from drivecomm.server import CurrentValue


def status(code: int) -> ua.StatusCode:
    """Return a status code object for a code in `ua.StatusCodes`."""
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
    """Return seconds since 1970 as an OPC UA time."""
    return ua.DateTime.fromtimestamp(time_s, UTC)


def now() -> ua.DateTime:
    """Return the present time."""
    return ua.DateTime.now(UTC)


def good(value: object, kind: ua.VariantType) -> ua.DataValue:
    """Return a data value of this server itself, good as of now."""
    time = now()
    return ua.DataValue(ua.Variant(value, kind, is_array=isinstance(value, list)), GOOD, time, time)


def waiting() -> ua.DataValue:
    """Return the data value before the first reading."""
    return ua.DataValue(NULL, NOT_YET, None, now())


def missing(time_s: float, seen_s: float) -> ua.DataValue:
    """Return the data value of a missing value. time_s: when it went missing. seen_s: when the server received it."""
    return ua.DataValue(NULL, NO_COMMUNICATION, moment(time_s), moment(seen_s))


def variant_of(value: Value, kind: ua.VariantType | None) -> ua.Variant | None:
    """Return a value as a variant of this type; None if the types do not match. kind: None for the value's own type."""
    if isinstance(value, str):
        return ua.Variant(value, ua.VariantType.String) if kind in (None, ua.VariantType.String) else None
    if kind is ua.VariantType.String:
        return ua.Variant(str(value), ua.VariantType.String)
    return ua.Variant(float(value), ua.VariantType.Double)


def data_value(value: CurrentValue, kind: ua.VariantType | None, seen_s: float) -> ua.DataValue:
    """Return a current value as a data value.

    kind: type of its node, None for any. seen_s: when the server received it, in seconds since 1970.
    """
    reading = value.reading
    if reading is None or value.quality == "bad":
        status = NOT_CONFIGURED if value.unreadable else NO_COMMUNICATION
        return ua.DataValue(NULL, status, moment(value.time_s), moment(seen_s))
    variant = variant_of(reading.value, kind)
    if variant is None:
        return ua.DataValue(NULL, _OTHER_TYPE, moment(reading.time_s), moment(seen_s))
    return ua.DataValue(variant, STATUS_CODES[value.quality], moment(reading.time_s), moment(seen_s))


def as_stale(last: ua.DataValue) -> ua.DataValue:
    """Return a data value as stale."""
    if last.StatusCode not in (GOOD, UNCERTAIN):
        return last
    return ua.DataValue(last.Value, LAST_USABLE, last.SourceTimestamp, now())


def past_value(value: Value | None, quality: str, time_s: float) -> ua.DataValue:
    """Return a value of the history as a data value, which is null for a missing one."""
    if value is None or quality == "bad":
        return ua.DataValue(NULL, NO_COMMUNICATION, moment(time_s), None)
    return ua.DataValue(variant_of(value, None), STATUS_CODES[quality], moment(time_s), None)
