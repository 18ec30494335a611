"""A good reading with an unconfirmed model fact has quality good at every door, with the model's mark beside it."""

import json

from asyncua import ua
from every_door import until
from mosquitto import needs_mosquitto

pytestmark = needs_mosquitto

NOTE = "type and unit are derived"
"""Mark of the pump's output frequency."""


def test_http_door_shows_the_mark_as_a_note_and_as_a_label(hands):
    client = hands["http"].client("otto")

    def good():
        found = client.get("/api/v1/values").content
        return [
            each
            for each in found
            if (each["drive"], each["name"], each["quality"]) == ("pump", "output_frequency", "good")
        ]

    (found,) = until(good)
    assert (found["reading"]["quality"], found["reading"]["note"]) == ("good", NOTE)
    labels = 'drive="pump",line="hall",name="output_frequency"'
    until(lambda: f'drivecomm_sample_quality{{{labels},quality="good"}} 1' in metrics_of(client))
    assert f'drivecomm_sample_info{{{labels},note="{NOTE}"}} 1' in metrics_of(client)


def metrics_of(client):
    return client.get("/metrics").content.decode()


def test_mqtt_door_shows_the_mark_as_a_note(hands):
    def good():
        told = map(json.loads, hands["mqtt"].broker.of("drivecomm/hall/pump/output_frequency"))
        return [each for each in told if each["quality"] == "good"]

    assert until(good)[-1]["note"] == NOTE


def test_sparkplug_door_shows_the_mark_as_a_property(hands):
    hand = hands["sparkplug"]

    def good():
        births = hand.messages("DBIRTH", "pump")
        alias = next(each.alias for each in births[-1].metrics if each.name == "Values/output_frequency")
        told = [each for message in [*births, *hand.messages("DDATA", "pump")] for each in message.metrics]
        said = [
            dict(zip(each.properties.keys, each.properties.values, strict=True))
            for each in told
            if each.alias == alias and not each.is_null
        ]
        return [each for each in said if each["Quality"].int_value == 192]

    found = until(good)[-1]
    assert (found["Uncertain"].boolean_value, found["Reason"].string_value) == (True, NOTE)


def test_opc_ua_door_shows_the_mark_as_a_property(hands):
    hand, name = hands["opcua"], "drives/pump/Monitoring/ConverterOutputFrequency"

    def read(*parts):
        node = hand.otto.get_node(ua.NodeId("/".join((name, *parts)), 2))
        return hand.run(node.read_data_value(raise_on_bad_status=False))

    until(lambda: read().StatusCode.name == "Good")
    assert read("Note").Value.Value == NOTE


def test_modbus_tcp_door_shows_the_value_as_good(hands):
    assert until(lambda: hands["modbus-tcp"].words("pump")[10] == 192)
