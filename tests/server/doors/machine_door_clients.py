"""Clients of the doors for machines: OPC UA, and Modbus TCP registers."""

from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from types import MappingProxyType

from asyncua import Client as OpcuaClient, ua
from asyncua.sync import ThreadLoop
from commanded_plant import AGAIN, DONE, MINE, RESET, START, STOP, UNDER_WAY, Plc
from every_door import UNITS, token_of, until
from raw_master import Master, Refused

_OUTCOMES = {DONE: "done", 3: "refused", 4: "failed", 5: "open"}


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

    def run(self, work):
        """Run a coroutine of a client, and return its result."""
        return self._loop.post(work)

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
        with self._dated(self.otto, age_s):
            return self.call(self.otto, method, *arguments, on=f"drives/{drive}")[0]

    def stop(self, drive="pump"):
        with self._dated(self.vera, 10):
            return self.call(self.vera, "Stop", on=f"drives/{drive}")[0]

    @contextmanager
    def _dated(self, client, age_s):
        """Backdate the requests of a client by some seconds during the block."""
        protocol = client.uaclient.protocol
        begun = protocol._setup_request_header

        def dated(header, *given, **more):
            begun(header, *given, **more)
            header.Timestamp = datetime.now(UTC) - timedelta(seconds=age_s)

        protocol._setup_request_header = dated
        try:
            yield
        finally:
            protocol._setup_request_header = begun

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
    """A PLC. It writes a register image, which the door takes as a command when the sequence number changes."""

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

    def words(self, drive):
        """Return the readable registers of a drive."""
        return self._plcs[drive].master.read(0, 120)

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
