"""A stop in a message is found beside any other metrics, and with any type that hosts use."""

import time

import pytest

from drivecomm.errors import UsageError
from drivecomm.server.sparkplug.commanding import commands_in
from drivecomm.server.sparkplug.payload import DataType, decode_payload
from drivecomm.server.sparkplug.wire import payload_class


def asked(*metrics):
    """Return the commands in a message; each metric has a name, a type, the field of its value, and the value."""
    message = payload_class()(timestamp=int(time.time() * 1000))
    for name, kind, field, value in metrics:
        message.metrics.add(name=name, datatype=kind, **{field: value})
    payload = decode_payload(message.SerializeToString())
    return [(each.verb, dict(each.arguments)) for each in commands_in(payload, payload.metrics, "fan")]


STOP = ("Command/Stop", DataType.BOOLEAN, "boolean_value", True)
REFERENCE = ("Command/Reference Percent", DataType.DOUBLE, "int_value", 40)


@pytest.mark.parametrize(
    "beside",
    [
        REFERENCE,
        ("Command/Reference Percent", DataType.DOUBLE, "string_value", "40"),
        ("whatever", DataType.STRING, "boolean_value", True),
        ("Command/Session", DataType.STRING, "long_value", 7),
    ],
)
def test_stop_is_found_beside_invalid_metrics(beside):
    assert asked(STOP, beside) == [("stop", {})]
    assert asked(beside, STOP) == [("stop", {})]


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (DataType.INT32, "int_value", 1),
        (DataType.BOOLEAN, "int_value", 1),
        (DataType.INT64, "long_value", 1),
        (DataType.DOUBLE, "double_value", 1.0),
    ],
)
def test_stop_may_be_sent_as_a_number(kind, field, value):
    assert asked(("Command/Stop Coast", kind, field, value)) == [("stop", {"how": "coast"})]


@pytest.mark.parametrize(
    "wrong",
    [
        ("Command/Start", DataType.STRING, "boolean_value", True),
        ("Command/Start", DataType.INT32, "int_value", 1),
        ("Command/Stop", DataType.STRING, "string_value", "false"),
    ],
)
def test_other_command_with_a_wrong_type_is_refused(wrong):
    session = ("Command/Session", DataType.STRING, "string_value", "s")
    with pytest.raises(UsageError, match="takes a"):
        asked(wrong, session)


def test_stop_with_value_false_is_not_a_stop():
    assert asked(("Command/Stop", DataType.BOOLEAN, "boolean_value", False)) == []
