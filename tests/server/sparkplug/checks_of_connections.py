"""Checks of observed connections, wills and deaths."""

from itertools import pairwise

from sparkplug_grading import NAMESPACE, check, say
from sparkplug_plant import GROUP, HOST, NODE

from drivecomm.server.sparkplug.wire import payload_class

# Connections and deaths.


@check(
    "message-flow-edge-node-birth-publish-will-message", "message-flow-edge-node-birth-publish-will-message-topic",
    "message-flow-edge-node-birth-publish-will-message-qos",
    "message-flow-edge-node-birth-publish-will-message-will-retained", "payloads-ndeath-will-message",
    "payloads-ndeath-will-message-qos", "payloads-ndeath-will-message-retain",
)  # fmt: skip
def a_connection_has_the_death_as_its_will(seen):
    for each in seen.packet("CONNECT"):
        right = each.has_will and each.will_qos == 1 and not each.will_retain
        yield say(right and each.will_topic == f"{NAMESPACE}/{GROUP}/NDEATH/{NODE}", str(vars(each)))


@check("message-flow-edge-node-birth-publish-will-message-payload")
def a_will_has_the_number_of_the_connection(seen):
    for each in seen.packet("CONNECT"):
        yield say(_is_death(each.will), str(each.will))


@check("message-flow-edge-node-birth-publish-will-message-payload-bdSeq", "topics-nbirth-bdseq-increment")
def connections_are_numbered(seen):
    numbers = [each.will.metrics[0].long_value for each in seen.packet("CONNECT")]
    if numbers:
        yield say(numbers[0] == 0, f"begins at {numbers[0]}")
    for before, each in pairwise(numbers):
        yield say(each == (before + 1) % 256, str(numbers))


@check("principles-persistence-clean-session-50")
def connections_of_5_begin_clean(seen):
    for each in seen.packet("CONNECT"):
        if each.version == 5:
            yield say(each.clean and each.expiry_s == 0, str(vars(each)))


@check("principles-persistence-clean-session-311")
def connections_of_3_begin_clean(seen):
    for each in seen.packet("CONNECT"):
        if each.version == 4:
            yield say(each.clean, str(vars(each)))


@check("message-flow-edge-node-ncmd-subscribe", "message-flow-device-dcmd-subscribe")
def commands_are_subscribed_before_the_birth(seen):
    for _, packets in _connections(seen):
        births = [number for number, each in enumerate(packets) if _topic_kind(each) == "NBIRTH"]
        filters = {}
        for each in packets[: births[0]] if births else []:
            filters.update(each.filters if each.kind == "SUBSCRIBE" else {})
        if births:
            wanted = [f"{NAMESPACE}/{GROUP}/NCMD/{NODE}", f"{NAMESPACE}/{GROUP}/DCMD/{NODE}/+"]
            yield say([filters.get(each) for each in wanted] == [1, 1], str(filters))


@check("operational-behavior-primary-application-state-with-multiple-servers-state-subs")
def the_state_of_the_host_is_subscribed(seen):
    for _, packets in _connections(seen) if seen.host else []:
        filters = {}
        for each in packets:
            filters.update(each.filters if each.kind == "SUBSCRIBE" else {})
        if filters:
            yield say(filters.get(f"{NAMESPACE}/STATE/{HOST}") == 1, str(filters))


@check("message-flow-edge-node-birth-publish-connect")
def nothing_is_published_before_a_connection(seen):
    for connect, packets in _connections(seen):
        if packets:
            yield say(connect is not None, packets[0].kind)


@check(
    "topics-nbirth-bdseq-included", "payloads-nbirth-bdseq", "topics-nbirth-bdseq-matching",
    "payloads-nbirth-bdseq-repeat", "message-flow-edge-node-birth-publish-nbirth-payload-bdSeq",
    "operational-behavior-data-commands-rebirth-action-3",
)  # fmt: skip
def births_have_the_number_of_their_connection(seen):
    for connect, packets in _connections(seen):
        for each in packets:
            if _topic_kind(each) == "NBIRTH":
                metrics = payload_class().FromString(each.payload).metrics
                metric = next((metric for metric in metrics if metric.name == "bdSeq"), None)
                right = metric is not None and metric.datatype == 4
                yield say(right and metric.long_value == connect.will.metrics[0].long_value, str(metric))


@check("topics-ndeath-payload", "topics-ndeath-seq", "payloads-ndeath-seq", "payloads-ndeath-bdseq")
def a_death_of_the_node_has_one_number(seen):
    born = set()
    for each in seen.of("NBIRTH", "NDEATH"):
        if each.kind == "NBIRTH":
            born.add(each.metric("bdSeq").long_value)
        else:
            right = _is_death(each.message) and (not born or each.message.metrics[0].long_value in born)
            yield say(right or not born, str(each.message))


@check(
    "operational-behavior-edge-node-intentional-disconnect-ndeath", "payloads-ndeath-will-message-publisher",
)  # fmt: skip
def who_leaves_in_order_says_so_first(seen):
    for _, packets in _connections(seen):
        if packets and packets[-1].kind == "DISCONNECT" and any(_topic_kind(each) == "NBIRTH" for each in packets):
            yield say(_topic_kind(packets[-2]) == "NDEATH", _topic_kind(packets[-2]))


@check(
    "payloads-ndeath-will-message-publisher-disconnect-mqtt50",
    "operational-behavior-edge-node-intentional-disconnect-packet",
)  # fmt: skip
def who_leaves_with_5_wants_the_will(seen):
    for connect, packets in _connections(seen):
        if connect is not None and connect.version == 5 and packets and packets[-1].kind == "DISCONNECT":
            yield say(packets[-1].reason == 4, str(packets[-1].reason))


@check("payloads-ndeath-will-message-publisher-disconnect-mqtt311")
def who_leaves_with_3_says_so_first(seen):
    for connect, packets in _connections(seen):
        if connect is not None and connect.version == 4 and packets and packets[-1].kind == "DISCONNECT":
            yield say(_topic_kind(packets[-2]) == "NDEATH", _topic_kind(packets[-2]))


def _is_death(message):
    metric = message.metrics[0]
    return not message.HasField("seq") and len(message.metrics) == 1 and metric.name == "bdSeq" and metric.datatype == 4


def _topic_kind(packet):
    return packet.topic.split("/")[2] if packet.kind == "PUBLISH" else packet.kind


def _connections(seen):
    """Yield each connection, and the packets sent in it."""
    for each in dict.fromkeys(packet.connection for packet in seen.packets):
        packets = [packet for packet in seen.packets if packet.connection == each and packet.kind]
        connect = packets[0] if packets and packets[0].kind == "CONNECT" else None
        yield connect, packets[1:] if connect else packets
