"""Protobuf messages of a Sparkplug B payload, built on first use from their field numbers.

The numbers are facts of the specification. As data, they need no generated code, which would have to match the
installed version of protobuf, and no parser of our own for untrusted bytes. Data sets, templates and files are left
out: a reader keeps them as unknown fields.
"""

from __future__ import annotations

from functools import cache
from typing import Any

_PACKAGE = "drivecomm.sparkplug"

# Per message: name, number and type of each field; fields after | are alternatives for its one value.
_MESSAGES = {
    "PropertyValue": (
        "type 1 uint32, is_null 2 bool | int_value 3 uint32, long_value 4 uint64, float_value 5 float, "
        "double_value 6 double, boolean_value 7 bool, string_value 8 string"
    ),
    "PropertySet": "keys 1 *string, values 2 *PropertyValue",
    "Metric": (
        "name 1 string, alias 2 uint64, timestamp 3 uint64, datatype 4 uint32, is_historical 5 bool, "
        "is_transient 6 bool, is_null 7 bool, properties 9 PropertySet | int_value 10 uint32, long_value 11 uint64, "
        "float_value 12 float, double_value 13 double, boolean_value 14 bool, string_value 15 string, "
        "bytes_value 16 bytes"
    ),
    "Payload": "timestamp 1 uint64, metrics 2 *Metric, seq 3 uint64, uuid 4 string, body 5 bytes",
}


@cache
def payload_class() -> Any:
    """Return the protobuf class of a payload."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    file = descriptor_pb2.FileDescriptorProto(name="drivecomm_sparkplug.proto", package=_PACKAGE, syntax="proto2")
    for name, fields in _MESSAGES.items():
        _add(file.message_type.add(name=name), fields)
    # A separate pool avoids conflicts with another package's definitions of the same name.
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{_PACKAGE}.Payload"))


def _add(message: Any, fields: str) -> None:
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto

    plain, _, choice = fields.partition(" | ")
    if choice:
        message.oneof_decl.add(name="value")
    for text in filter(None, [*plain.split(", "), *choice.split(", ")]):
        name, number, kind = text.split()
        field = message.field.add(name=name, number=int(number))
        label = "LABEL_REPEATED" if kind.startswith("*") else "LABEL_OPTIONAL"
        field.label = FieldDescriptorProto.Label.Value(label)
        kind = kind.removeprefix("*")
        if kind in _MESSAGES:
            field.type = FieldDescriptorProto.Type.Value("TYPE_MESSAGE")
            field.type_name = f".{_PACKAGE}.{kind}"
        else:
            field.type = FieldDescriptorProto.Type.Value(f"TYPE_{kind.upper()}")
        if text in choice.split(", "):
            field.oneof_index = 0
