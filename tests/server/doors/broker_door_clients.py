"""Clients of the doors behind a broker: an MQTT client and a Sparkplug primary host."""

import json
import time
from types import MappingProxyType

import paho.mqtt.client as paho
from every_door import GROUP, HOST, NODE, token_of, until
from json_door_clients import ANOTHER_TIME, NUMBERS, JsonHand, LinesHand
from paho.mqtt.subscribeoptions import SubscribeOptions

from drivecomm.server.sparkplug.payload import DataType, Metric, Payload, encode_payload
from drivecomm.server.sparkplug.wire import payload_class


class Subscriber:
    """A client of the broker that records every received message."""

    def __init__(self, broker, topic):
        self.heard = []
        self.client = paho.Client(paho.CallbackAPIVersion.VERSION2, protocol=paho.MQTTv5)
        self.client.on_message = lambda _client, _data, message: self.heard.append((message.topic, message.payload))
        self.client.connect("127.0.0.1", broker.port)
        self.client.loop_start()
        until(self.client.is_connected)
        self.client.subscribe(topic, options=SubscribeOptions(qos=1, retainAsPublished=True))

    def publish(self, topic, payload, *, retain=False):
        self.client.publish(topic, payload, qos=1, retain=retain).wait_for_publish(10)

    def of(self, topic):
        return [payload for name, payload in list(self.heard) if name == topic and payload]

    def close(self):
        self.client.disconnect()
        self.client.loop_stop()


class MqttHand(JsonHand):
    kind = "mqtt"
    wrong = MappingProxyType({**LinesHand.wrong, "without a validity": {"valid_s": None}})

    def __init__(self, hall):
        super().__init__(hall)
        self.broker = Subscriber(hall.broker, "drivecomm/hall/#")
        self.session = json.loads(until(lambda: self.broker.of("drivecomm/hall/bridge/state"))[-1])["session"]

    def ask(self, topic, answers, content, *, retain=False):
        before = len(self.broker.of(f"drivecomm/hall/{answers}"))

        def answered():
            told = map(json.loads, self.broker.of(f"drivecomm/hall/{answers}")[before:])
            # The reply to a command may arrive while a stop waits for its own.
            return [each for each in told if (each.get("verb") == "stop") is topic.endswith("/stop")]

        self.broker.publish(f"drivecomm/hall/{topic}", json.dumps(content), retain=retain)
        return until(answered)[0]

    def lease(self, what, **content):
        asked = {"id": f"n{next(NUMBERS)}", "session": self.session, "token": token_of("otto"), "drive": "pump"}
        answer = self.ask(f"bridge/request/lease/{what}", f"bridge/response/lease/{what}", {**asked, **content})
        return answer["result"] if answer["outcome"] == "done" else {}

    def hold(self):
        self.key = self.lease("take", seconds=20).get("key", "")
        return bool(self.key)

    def command(self, verb, who="otto", **changes):
        name, content = self.content(verb, **changes)
        return {"verb": name, **content, **({"token": token_of(who)} if who else {})}

    def give(self, verb, drive="pump", **changes):
        return self.ask(f"{drive}/command", f"{drive}/response", self.command(verb, **changes))["outcome"]

    def retained(self, verb):
        topic = "pump/command"
        try:
            return self.ask(topic, "pump/response", self.command(verb), retain=True)["outcome"]
        finally:
            self.broker.publish(f"drivecomm/hall/{topic}", b"", retain=True)

    def stop(self, drive="pump"):
        return self.ask(f"{drive}/stop", f"{drive}/response", {"token": token_of("vera"), **ANOTHER_TIME})["outcome"]

    def stranger(self, verb):
        if verb == "stop":
            return self.ask("pump/stop", "pump/response", {})["outcome"]
        return self.ask("pump/command", "pump/response", self.command(verb, who=""))["outcome"]

    def close(self):
        self.broker.close()


class SparkplugHand:
    """A Sparkplug primary host.

    It acquires a lease only by a start. Hosts have no identity apart from the broker.
    """

    kind = "sparkplug"
    wrong = MappingProxyType(
        {
            "old": {"age_s": 10},
            "from the future": {"age_s": -10},
            "of an earlier run": {"session": "another run"},
            "without a session": {"session": ""},
            "without its time": {"timed": False},
        }
    )
    starts_without_a_lease = True

    def __init__(self, hall):
        self.hall = hall
        self.broker = Subscriber(hall.broker, f"spBv1.0/{GROUP}/#")
        self.online(True)
        until(lambda: self.messages("DBIRTH", "pump") and self.messages("NBIRTH"))
        (self.session,) = [
            each.string_value for each in self.messages("NBIRTH")[-1].metrics if each.name == "Properties/Session"
        ]

    def online(self, is_online):
        said = json.dumps({"online": is_online, "timestamp": round(time.time() * 1000)})
        self.broker.publish(f"spBv1.0/STATE/{HOST}", said, retain=True)

    def messages(self, kind, device=""):
        topic = f"spBv1.0/{GROUP}/{kind}/{NODE}" + (f"/{device}" if device else "")
        return [payload_class().FromString(each) for each in self.broker.of(topic)]

    def outcomes(self, drive, *, of_stops):
        """Return the outcomes that the metrics of a drive report for its commands, or for its stops."""
        births = self.messages("DBIRTH", drive)
        names = {each.alias: each.name for birth in births for each in birth.metrics}
        told = [
            {names[each.alias]: each.string_value for each in message.metrics}
            for message in self.messages("DDATA", drive)
        ]
        answers = [each for each in told if "Answer/Outcome" in each]
        return [each["Answer/Outcome"] for each in answers if (each["Answer/Command"] == "stop") is of_stops]

    def payload(self, metrics, *, age_s=0, timed=True):
        time_ms = round((time.time() - age_s) * 1000) if timed else None
        return encode_payload(
            Payload(metrics=tuple(metrics), time_ms=time_ms, uuid=f"n{next(NUMBERS)}"), say_types=True
        )

    def send(self, drive, payload, *, retain=False, stops=False):
        before, deaths = len(self.outcomes(drive, of_stops=stops)), len(self.messages("DDEATH", drive))

        def answered():
            # The metrics of a dead device no longer change.
            died = ["failed"] if len(self.messages("DDEATH", drive)) > deaths else []
            return self.outcomes(drive, of_stops=stops)[before:] or died

        self.broker.publish(f"spBv1.0/{GROUP}/DCMD/{NODE}/{drive}", payload, retain=retain)
        return until(answered)[0]

    def command(self, verb, *, session=None, **changes):
        metric = {
            "start": Metric(name="Command/Start", type=DataType.BOOLEAN, value=True),
            "reference": Metric(name="Command/Reference Percent", type=DataType.DOUBLE, value=20.0),
            "reset": Metric(name="Command/Reset", type=DataType.BOOLEAN, value=True),
        }[verb]
        word = Metric(name="Command/Session", type=DataType.STRING, value=self.session if session is None else session)
        return self.payload([metric, word], **changes)

    def hold(self):
        """Wait until the device is born; the later start acquires the lease."""
        end = f"/{NODE}/pump"

        def is_born():
            topics = [topic for topic, _ in list(self.broker.heard) if topic.endswith(end)]
            kinds = [each.split("/")[2] for each in topics if "/DBIRTH/" in each or "/DDEATH/" in each]
            return kinds[-1] == "DBIRTH"

        return until(is_born)

    def give(self, verb, drive="pump", **changes):
        return self.send(drive, self.command(verb, **changes))

    def repeat(self, times):
        message = self.command("reference")
        return [self.send("pump", message) for _ in range(times)]

    def retained(self, verb):
        try:
            return self.send("pump", self.command(verb), retain=True)
        finally:
            self.broker.publish(f"spBv1.0/{GROUP}/DCMD/{NODE}/pump", b"", retain=True)

    def stop(self, drive="pump"):
        pressed = Metric(name="Command/Stop", type=DataType.BOOLEAN, value=True)
        return self.send(drive, self.payload([pressed], timed=False), stops=True)

    def let_go(self):
        """Do nothing: the lease ends when the motor stops."""

    def close(self):
        self.online(False)
        self.broker.close()
