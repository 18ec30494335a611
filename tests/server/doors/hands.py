"""Clients of each door: how they hold a drive, command it and stop it over a real connection.

`give` returns what became of a command as the door answers it; `wrong` names the ways in which a command of this door
can be wrong, with what to change in it.
"""

import json
import socket
import threading
import time
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from itertools import count
from types import MappingProxyType

import paho.mqtt.client as paho
from asyncua import Client as OpcuaClient, ua
from asyncua.sync import ThreadLoop
from commanded_plant import AGAIN, DONE, MINE, RESET, START, STOP, UNDER_WAY, Plc
from every_door import GROUP, HOST, NODE, UNITS, token_of, until
from fake_plant import Client as HttpClient
from paho.mqtt.subscribeoptions import SubscribeOptions
from raw_master import Master, Refused

from drivecomm.server.sparkplug.payload import DataType, Metric, Payload, encoded
from drivecomm.server.sparkplug.wire import payload_class

VERBS = {"start": ("start", {}), "reference": ("set_reference", {"percent": 20}), "reset": ("reset", {})}
_NUMBERS = count(1)


class JsonHand:
    """What clients of doors share that take commands as JSON."""

    wrong = MappingProxyType(
        {
            "old": {"issued_s": lambda: time.time() - 10},
            "from the future": {"issued_s": lambda: time.time() + 10},
            "of an earlier run": {"session": "another run"},
            "without an id": {"id": None},
            "valid for too long": {"valid_s": 60},
        }
    )

    def __init__(self, hall):
        self.hall, self.key = hall, ""

    def content(self, verb, **changes):
        name, arguments = VERBS[verb]
        content = {
            "id": f"n{next(_NUMBERS)}",
            "session": self.session,
            "issued_s": time.time(),
            "valid_s": 2,
            "arguments": arguments,
            **({"lease": self.key} if self.key else {}),
            **{key: each() if callable(each) else each for key, each in changes.items()},
        }
        return name, {key: each for key, each in content.items() if each is not None}

    def let_go(self):
        self.key = ""

    def close(self):
        """Leave."""


class HttpHand(JsonHand):
    kind = "http"

    def __init__(self, hall):
        super().__init__(hall)
        self.session = self.client("otto").get("/api/v1/plant").content["session"]

    def client(self, name):
        return HttpClient(self.hall.doors["http"], token_of(name) if name else "")

    def post(self, who, path, content):
        found = self.client(who).post(f"/api/v1/drives/{path}", **content)
        return found.content.get("outcome", "refused"), found.content

    def hold(self):
        _, content = self.post("otto", "pump/lease", {"seconds": 20})
        self.key = content.get("key", "")
        return bool(self.key)

    def give(self, verb, drive="pump", **changes):
        name, content = self.content(verb, **changes)
        return self.post("otto", f"{drive}/{name}", content)[0]

    def stop(self, drive="pump"):
        return self.post("vera", f"{drive}/stop", {})[0]

    def stranger(self, verb):
        name, content = ("stop", {"id": "x"}) if verb == "stop" else self.content(verb)
        return self.post("", f"pump/{name}", content)[0]


class LinesHand(JsonHand):
    kind = "lines"
    wrong = MappingProxyType(
        {
            **JsonHand.wrong,
            "without a session": {"session": None},
            "without its time": {"issued_s": None},
            "with nonsense": {"valid_s": "soon"},
        }
    )

    def __init__(self, hall):
        super().__init__(hall)
        self.socket = socket.create_connection(("127.0.0.1", hall.doors["lines"].address.port), timeout=20)
        self.answers, self._lock = {}, threading.Condition()
        threading.Thread(target=self._hear, daemon=True).start()
        self.session = self.ask("hello", "otto")["result"]["session"]

    def _hear(self):
        with suppress(OSError, ValueError), self.socket.makefile("rb") as lines:
            for line in lines:
                with self._lock:
                    answer = json.loads(line)
                    self.answers.setdefault(answer["id"], []).append(answer)
                    self._lock.notify_all()

    def ask(self, verb, who, drive="pump", **content):
        token = {"token": token_of(who)} if who else {}
        one, before = content.get("id", ""), len(self.answers.get(content.get("id", ""), ()))
        line = {**token, "verb": verb, "drive": drive, **content}
        self.socket.sendall(json.dumps(line).encode() + b"\n")
        with self._lock:
            assert self._lock.wait_for(lambda: len(self.answers.get(one, ())) > before, 30)
            return self.answers[one][before]

    def hold(self):
        return self.ask("take_lease", "otto", **self.content("start")[1])["outcome"] == "done"

    def let_go(self):
        self.ask("end_lease", "otto", **self.content("start")[1])

    def give(self, verb, drive="pump", **changes):
        name, content = self.content(verb, **changes)
        return self.ask(name, "otto", drive, **content)["outcome"]

    def stop(self, drive="pump"):
        return self.ask("stop", "vera", drive)["outcome"]

    def stranger(self, verb):
        name, content = ("stop", {}) if verb == "stop" else self.content(verb)
        return self.ask(name, "", **content)["outcome"]

    def close(self):
        self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()


class Subscriber:
    """A client of the broker that keeps what it receives."""

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
            # A command may be answered while a stop is.
            return [each for each in told if (each.get("verb") == "stop") is topic.endswith("/stop")]

        self.broker.publish(f"drivecomm/hall/{topic}", json.dumps(content), retain=retain)
        return until(answered)[0]

    def lease(self, what, **content):
        asked = {"id": f"n{next(_NUMBERS)}", "session": self.session, "token": token_of("otto"), "drive": "pump"}
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
        return self.ask(f"{drive}/stop", f"{drive}/response", {"token": token_of("vera")})["outcome"]

    def stranger(self, verb):
        if verb == "stop":
            return self.ask("pump/stop", "pump/response", {})["outcome"]
        return self.ask("pump/command", "pump/response", self.command(verb, who=""))["outcome"]

    def close(self):
        self.broker.close()


class SparkplugHand:
    """A primary host. It cannot take a lease but by a start, and hosts are known by the broker alone."""

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
        """What the metrics of a drive have said of its commands, or of its stops."""
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
        return encoded(Payload(metrics=tuple(metrics), time_ms=time_ms, uuid=f"n{next(_NUMBERS)}"), say_types=True)

    def send(self, drive, payload, *, retain=False, stops=False):
        before, deaths = len(self.outcomes(drive, of_stops=stops)), len(self.messages("DDEATH", drive))

        def answered():
            # The metrics of a dead device say nothing more.
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
        """Nothing to do: the start takes the lease."""
        return True

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
        """Nothing to do: the lease ends with the motor."""

    def close(self):
        self.online(False)
        self.broker.close()


class OpcuaHand:
    kind = "opcua"
    wrong = MappingProxyType({"old": {"age_s": 10}})

    def __init__(self, hall):
        self.hall, self._loop = hall, ThreadLoop()
        self._loop.start()
        self.otto, self.vera = self._client("otto"), self._client("vera")

    def _client(self, name, token=None):
        client = OpcuaClient(f"opc.tcp://127.0.0.1:{self.hall.doors['opcua'].port}/", timeout=20)
        if name:
            client.set_user(name)
            client.set_password(token or token_of(name))
        self._loop.post(client.connect())
        return client

    def call(self, client, method, *arguments, on):
        request = ua.CallMethodRequest(
            ObjectId=ua.NodeId(on, 2),
            MethodId=ua.NodeId(f"methods/{method}", 2),
            InputArguments=[ua.Variant(each) for each in arguments],
        )
        (result,) = self._loop.post(client.uaclient.call([request]))
        return [each.Value for each in result.OutputArguments or []] or ["refused"]

    def hold(self):
        return self.call(self.otto, "InitLock", "a test", on="drives/pump/Lock")[0] == 0

    def let_go(self):
        self.call(self.otto, "ExitLock", on="drives/pump/Lock")

    def give(self, verb, drive="pump", *, age_s=0):
        method, arguments = {
            "start": ("Start", ()),
            "reference": ("SetReference", (20.0, "%")),
            "reset": ("ResetFault", ()),
        }[verb]
        protocol = self.otto.uaclient.protocol
        begun = protocol._setup_request_header

        def dated(header, *given, **more):
            begun(header, *given, **more)
            header.Timestamp = datetime.now(UTC) - timedelta(seconds=age_s)

        protocol._setup_request_header = dated
        try:
            return self.call(self.otto, method, *arguments, on=f"drives/{drive}")[0]
        finally:
            protocol._setup_request_header = begun

    def stop(self, drive="pump"):
        return self.call(self.vera, "Stop", on=f"drives/{drive}")[0]

    def stranger(self, verb):
        for name, token in (("", None), ("otto", "a guess")):
            try:
                client = self._client(name, token)
            except ua.UaError:
                continue
            method = {"stop": "Stop", "start": "Start"}[verb]
            outcome = self.call(client, method, on="drives/pump")[0]
            self._loop.post(client.disconnect())
            if outcome != "refused":
                return outcome
        return "refused"

    def close(self):
        for client in (self.otto, self.vera):
            self._loop.post(client.disconnect())
        self._loop.stop()


class ModbusTcpHand:
    """A PLC. What it writes is an image, which a door takes for a command when its sequence changes."""

    kind = "modbus-tcp"
    wrong = MappingProxyType({"seen first on a connection": {"first": True}})

    def __init__(self, hall):
        self.hall = hall
        self._plcs = {drive: self._plc(drive) for drive in UNITS}
        for plc in self._plcs.values():
            plc.write()

    def _plc(self, drive, address="127.0.0.1"):
        return Plc(Master(self.hall.doors["modbus-tcp"].port, UNITS[drive], address=address))

    def hold(self):
        plc = self._plcs["pump"]
        for _ in range(5):
            plc.cycle()
        with suppress(AssertionError):
            plc.cycles_until(lambda: plc.results().lease == MINE, 1.0)
        return plc.results().lease == MINE

    def let_go(self):
        plc = self._plcs["pump"]
        plc.heartbeat = plc.kind = 0
        plc.write()

    def give(self, verb, drive="pump", *, first=False):
        plc = self._plcs[drive]
        plc.command, plc.sequence = {"start": START, "reference": AGAIN, "reset": RESET}[verb], plc.sequence + 1
        if verb == "reference":
            plc.kind, plc.reference = 1, 20.0
        if first:
            return self._seen_first(drive, plc)
        return _OUTCOMES[plc.answered().outcome]

    def _seen_first(self, drive, plc):
        another = self._plc(drive)
        try:
            another.sequence, another.command = plc.sequence, plc.command
            another.write()
            return "done" if another.results().answered == another.sequence else "refused"
        finally:
            another.master.close()

    def repeat(self, times):
        outcomes = [self.give("reference")]
        for _ in range(times - 1):
            self._plcs["pump"].cycle()
            outcomes.append(_OUTCOMES[self._plcs["pump"].results().outcome])
        return outcomes

    def stop(self, drive="pump"):
        plc = self._plc(drive)
        try:
            plc.master.write_one(STOP, 1)
            until(lambda: plc.results().stop_outcome > UNDER_WAY)
            outcome = plc.results().stop_outcome
            plc.master.write_one(STOP, 0)
            return _OUTCOMES[outcome]
        finally:
            plc.master.close()

    def stranger(self, verb):
        plc = self._plc("pump", address="127.0.0.2")
        try:
            plc.master.write_one(STOP, 1 if verb == "stop" else 0)
        except Refused:
            return "refused"
        finally:
            plc.master.close()
        return "done"

    def close(self):
        for plc in self._plcs.values():
            plc.master.close()


_OUTCOMES = {DONE: "done", 3: "refused", 4: "failed", 5: "open"}

HANDS = {hand.kind: hand for hand in (HttpHand, LinesHand, ModbusTcpHand, MqttHand, OpcuaHand, SparkplugHand)}
