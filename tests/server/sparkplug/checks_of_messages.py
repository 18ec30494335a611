"""Checks of observed topics, message options, and sequence numbers."""

from itertools import pairwise

from sparkplug_grading import BIRTHS, COUNTED, DATA, NAMESPACE, check, say
from sparkplug_listener import DEVICE_KINDS, NODE_KINDS
from sparkplug_plant import GROUP, NODE

# Topics and names.


@check("topic-structure", "topic-structure-namespace-a")
def begins_with_the_namespace(seen):
    for each in seen.of(*COUNTED, "NDEATH"):
        yield say(each.parts[0] == NAMESPACE and len(each.parts) in (4, 5), each.topic)


@check(
    "topic-structure-namespace-device-id-associated-message-types", "topics-dbirth-topic", "topics-ddata-topic",
    "topics-ddeath-topic", "message-flow-device-birth-publish-dbirth-topic",
    "message-flow-device-birth-publish-dbirth-match-edge-node-topic",
)  # fmt: skip
def device_messages_name_their_device(seen):
    for each in seen.heard:
        if each.kind in DEVICE_KINDS:
            yield say(each.parts[1:4] == [GROUP, each.kind, NODE] and each.device, each.topic)


@check(
    "topic-structure-namespace-device-id-non-associated-message-types", "topics-nbirth-topic", "topics-ndata-topic",
    "topics-ndeath-topic", "message-flow-edge-node-birth-publish-nbirth-topic",
)  # fmt: skip
def node_messages_name_no_device(seen):
    for each in seen.heard:
        if each.kind in NODE_KINDS:
            yield say(each.parts[1:] == [GROUP, each.kind, NODE], each.topic)


@check(
    "intro-group-id-string", "intro-group-id-chars", "intro-edge-node-id-string", "intro-edge-node-id-chars",
    "intro-device-id-string", "intro-device-id-chars", "topic-structure-namespace-valid-group-id",
    "topic-structure-namespace-valid-edge-node-id", "topic-structure-namespace-valid-device-id",
)  # fmt: skip
def names_have_no_reserved_characters(seen):
    for each in seen.of("DBIRTH"):
        names = each.parts[1], each.parts[3], each.device
        yield say(all(name and not set(name) & set("+/#") for name in names), each.topic)


@check("topic-structure-namespace-unique-device-id", "case-sensitivity-sparkplug-ids")
def devices_are_told_apart(seen):
    ids = {each.device for each in seen.of("DBIRTH")}
    if ids:
        yield say(len({each.casefold() for each in ids}) == len(ids), str(ids))


@check("case-sensitivity-metric-names")
def metrics_are_told_apart(seen):
    for each in seen.of(*BIRTHS):
        names = [metric.name for metric in each.message.metrics]
        yield say(len({name.casefold() for name in names}) == len(names), f"{each.topic}: {names}")


# Message options.


def _sent(kinds):
    def of_kinds(seen):
        for each in seen.of(*kinds):
            yield say(each.qos == 0 and not each.retain, f"{each.topic}: QoS {each.qos}, retain {each.retain}")

    return of_kinds


check(
    "topics-nbirth-mqtt", "payloads-nbirth-qos", "payloads-nbirth-retain",
    "message-flow-edge-node-birth-publish-nbirth-qos", "message-flow-edge-node-birth-publish-nbirth-retained",
)(_sent(["NBIRTH"]))  # fmt: skip
check(
    "topics-dbirth-mqtt", "payloads-dbirth-qos", "payloads-dbirth-retain",
    "message-flow-device-birth-publish-dbirth-qos", "message-flow-device-birth-publish-dbirth-retained",
)(_sent(["DBIRTH"]))  # fmt: skip
check("topics-ndata-mqtt", "payloads-ndata-qos", "payloads-ndata-retain")(_sent(["NDATA"]))
check("topics-ddata-mqtt", "payloads-ddata-qos", "payloads-ddata-retain")(_sent(["DDATA"]))
check("topics-ddeath-mqtt")(_sent(["DDEATH"]))


def _timed(kinds):
    def of_kinds(seen):
        for each in seen.of(*kinds):
            yield say(each.message.timestamp > 1_600_000_000_000, f"{each.topic}: {each.message.timestamp}")

    return of_kinds


check("topics-nbirth-timestamp", "payloads-nbirth-timestamp")(_timed(["NBIRTH"]))
check("topics-dbirth-timestamp", "payloads-dbirth-timestamp")(_timed(["DBIRTH"]))
check("topics-ndata-timestamp", "payloads-ndata-timestamp")(_timed(["NDATA"]))
check("topics-ddata-timestamp", "payloads-ddata-timestamp")(_timed(["DDATA"]))
check("payloads-ddeath-timestamp")(_timed(["DDEATH"]))
check("payloads-timestamp-in-UTC")(_timed(COUNTED))


@check(
    "message-flow-edge-node-birth-publish-nbirth-payload", "message-flow-device-birth-publish-dbirth-payload",
)  # fmt: skip
def births_are_payloads(seen):
    for each in seen.of(*BIRTHS):
        yield say(each.message.IsInitialized() and each.message.metrics, each.topic)


# Sequence numbers.


@check("payloads-sequence-num-always-included")
def everything_but_the_death_of_the_node_has_a_number(seen):
    for each in seen.of(*COUNTED):
        yield say(each.message.HasField("seq") and 0 <= each.message.seq <= 255, each.topic)


@check(
    "topics-nbirth-seq-num", "payloads-nbirth-seq", "payloads-sequence-num-req-nbirth",
    "message-flow-edge-node-birth-publish-nbirth-payload-seq",
)  # fmt: skip
def a_birth_of_the_node_begins_at_zero(seen):
    for each in seen.of("NBIRTH"):
        yield say(each.message.HasField("seq") and each.message.seq == 0, f"{each.message.seq}")


def _in_sequence(kinds):
    def of_kinds(seen):
        for session in seen.sessions():
            for before, each in pairwise(session):
                if each.kind in kinds:
                    right = each.message.seq == (before.message.seq + 1) % 256
                    yield say(right, f"{each.topic}: {each.message.seq} after {before.message.seq}")

    return of_kinds


check(
    "topics-dbirth-seq", "payloads-dbirth-seq", "payloads-dbirth-seq-inc",
    "message-flow-device-birth-publish-dbirth-payload-seq",
)(_in_sequence(["DBIRTH"]))  # fmt: skip
check("topics-ndata-seq-num", "payloads-ndata-seq", "payloads-ndata-seq-inc")(_in_sequence(["NDATA"]))
check("topics-ddata-seq-num", "payloads-ddata-seq", "payloads-ddata-seq-inc")(_in_sequence(["DDATA"]))
check(
    "topics-ddeath-seq-num", "payloads-ddeath-seq", "payloads-ddeath-seq-inc", "payloads-ddeath-seq-number",
)(_in_sequence(["DDEATH"]))  # fmt: skip
check("payloads-sequence-num-incrementing")(_in_sequence(COUNTED))


@check("message-flow-device-birth-publish-nbirth-wait", "principles-birth-certificates-order")
def a_session_begins_with_the_birth_of_the_node(seen):
    for session in seen.sessions():
        yield say(session[0].kind == "NBIRTH", session[0].topic)


@check("payloads-dbirth-order", "payloads-ndata-order", "payloads-ddata-order")
def no_data_before_the_births(seen):
    """Check that each device is born before the first data of a session, or after its own death.

    A device may also be born later if it was missing at the beginning of the session.
    """
    for session in seen.sessions():
        born, data, dead = set(), set(), set()
        for each in session:
            if each.kind == "DBIRTH":
                yield say(not data or each.device not in born or each.device in dead, f"{each.topic} after data")
                born.add(each.device)
            elif each.kind == "DDEATH":
                dead.add(each.device)
            elif each.kind in DATA:
                data.add(each.device)
                yield say(not each.device or each.device in born, f"{each.topic} before its birth")
