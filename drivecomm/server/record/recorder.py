"""Recording from a broker: each message is acknowledged only after the database has committed it.

The broker keeps the session of an absent recorder, so that nothing is lost. A message that is delivered again after a
crash has the same key, so that nothing is stored twice. A single thread alternates between writing and receiving.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import aiomqtt
import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.subscribeoptions import SubscribeOptions

from drivecomm.errors import DriveCommError, LinkDownError, LinkError, UsageError, in_one_line
from drivecomm.link import Backoff
from drivecomm.server.broker import VersionRefused, refusal, tls_context
from drivecomm.server.record.messages import records_in
from drivecomm.server.record.writer import Writer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from threading import Event

    from paho.mqtt.reasoncodes import ReasonCode

    from drivecomm.server.broker import BrokerSettings
    from drivecomm.server.record.database import Database
    from drivecomm.server.record.layout import Layout
    from drivecomm.server.record.messages import Recorded

UNDER_WAY = 4000
"""Unacknowledged messages that the broker may deliver; with MQTT 3.1.1 the broker decides."""
WRITTEN_EVERY_S = 0.25
"""Maximum delay of a value in seconds, as long as the database keeps up."""
ROWS_AT_ONCE = 10_000
SESSION_S = 30 * 86_400
"""Seconds for which the broker keeps messages for an absent recorder."""
_TAKEN_OVER = 0x8E
_CONNECTING_S = 4.0
_LOOK_S = 0.05
_FIRST_S, _LONGEST_S = 0.5, 5.0
_LASTED_S, _LOST_SOON, _LOST_SOON_PAUSE_S = 10.0, 4, 15.0
"""Least life of a good connection in s; shorter ones in a row that suggest a name conflict; the pause in s then."""
_UNFIT = (ValueError, TypeError, KeyError, AttributeError, ArithmeticError, RecursionError)


class _Waiting:
    """Received message that is not stored yet. client: its connection. number: its id on that connection."""

    __slots__ = ("client", "content", "number", "qos")

    def __init__(self, client: paho.Client, number: int, qos: int, content: Sequence[Recorded]) -> None:
        self.client, self.number, self.qos, self.content = client, number, qos, content


class BrokerRecorder:
    """Recorder of the plants on a broker.

    open_database: called when a database is needed, also after a lost connection. layout: topics of the plants. name:
    identifies the recorder and its session to the broker. share: recorders with the same word share the messages, which
    needs MQTT 5; "" for all messages. tell: called once when the broker or the database becomes unreachable, and once
    when it is reachable again.
    """

    def __init__(
        self,
        settings: BrokerSettings,
        open_database: Callable[[], Database],
        *,
        layout: Layout,
        name: str = "record",
        share: str = "",
        tell: Callable[[str], None],
    ) -> None:
        self.values = 0
        """Number of values that this run has added to the record."""
        self.unreadable = 0
        """Number of invalid messages, and of rows that the database could not store."""
        self._settings, self._open_database, self._tell = settings, open_database, tell
        self._layout, self._share = layout, share
        self._client_id = settings.client_id or f"drivecomm-record-{name}"
        self._client: paho.Client | None = None
        self._problem: DriveCommError | None = None
        self._connected_s = 0.0
        self._lost_soon = 0
        self._database: Database | None = None
        self._writer: Writer | None = None
        self._waiting: list[_Waiting] = []
        self._rows = 0
        self._since_s = 0.0
        self._pauses = {"broker": Backoff(_FIRST_S, _LONGEST_S), "database": Backoff(_FIRST_S, _LONGEST_S)}
        self._told: dict[str, str] = {}

    def run(self, end: Event) -> None:
        """Record until the event is set. Raises UsageError for a broker or a database that can never be used."""
        try:
            while not end.is_set():
                self._open()
                self._connect()
                if self._client is None:
                    end.wait(_LOOK_S)
                elif (code := self._client.loop(_LOOK_S)) != MQTTErrorCode.MQTT_ERR_SUCCESS:
                    self._lost(self._problem or LinkDownError(f"the connection was lost: {paho.error_string(code)}"))
                if self._rows >= ROWS_AT_ONCE or (self._waiting and time.monotonic() - self._since_s > WRITTEN_EVERY_S):
                    self._write()
            while self._waiting and self._writer is not None:
                self._write()
        finally:
            self._disconnect()
            if self._database is not None:
                self._database.close()

    # Database

    def _open(self) -> None:
        if self._database is not None or not self._is_due("database"):
            return
        try:
            self._database = self._open_database()
        except LinkError as error:
            self._failed("database", error)
        else:
            self._writer = Writer(self._database)
            self._succeeded("database", self._database.place)

    def _write(self) -> None:
        """Store the oldest waiting messages and acknowledge them; without a database they keep waiting."""
        if self._writer is None or not self._waiting:
            return
        count = rows = 0
        while count < len(self._waiting) and rows < ROWS_AT_ONCE:
            rows += len(self._waiting[count].content)
            count += 1
        written = self._waiting[:count]
        try:
            self._store([row for each in written for row in each.content])
        except LinkError as error:
            if self._database is not None:
                self._database.close()
            self._database = self._writer = None
            self._failed("database", error)
            return
        del self._waiting[:count]
        self._rows -= rows
        for each in written:
            # The broker sends messages of an earlier connection again, so that only the later delivery is acknowledged.
            if each.client is self._client and each.qos:
                each.client.ack(each.number, each.qos)

    def _store(self, rows: Sequence[Recorded]) -> None:
        """Store rows; a row that the database cannot store is skipped. Raises LinkError."""
        if self._writer is None or not rows:
            return
        try:
            self.values += self._writer.write(rows)
        except ValueError:
            if len(rows) == 1:
                self.unreadable += 1
                return
            half = len(rows) // 2
            self._store(rows[:half])
            self._store(rows[half:])

    # Broker

    def _connect(self) -> None:
        if self._client is not None or not self._is_due("broker"):
            return
        settings, self._problem = self._settings, None
        is_5 = settings.version == "5"
        client = paho.Client(
            CallbackAPIVersion.VERSION2,
            client_id=self._client_id,
            protocol=paho.MQTTv5 if is_5 else paho.MQTTv311,
            clean_session=None if is_5 else False,
            manual_ack=True,
            reconnect_on_failure=False,
        )
        client.on_connect, client.on_subscribe = self._on_connect, self._on_subscribe
        client.on_message, client.on_disconnect = self._on_message, self._on_disconnect
        client.connect_timeout = _CONNECTING_S
        if settings.tls:
            client.tls_set_context(tls_context(settings))
        if settings.user:
            client.username_pw_set(settings.user, settings.password() if settings.password else None)
        try:
            if is_5:
                kept = Properties(PacketTypes.CONNECT)
                kept.SessionExpiryInterval, kept.ReceiveMaximum = SESSION_S, UNDER_WAY
                client.connect(settings.host, settings.port, settings.keep_alive_s, clean_start=False, properties=kept)
            else:
                client.connect(settings.host, settings.port, settings.keep_alive_s)
        except (OSError, ValueError) as error:
            self._failed("broker", refusal(settings, self._client_id, error))
        else:
            self._client = client

    def _on_connect(self, client: paho.Client, _: Any, __: Any, code: ReasonCode, ___: Any) -> None:
        if code.is_failure:
            self._problem = refusal(self._settings, self._client_id, aiomqtt.MqttCodeError(code))
            client.disconnect()
            return
        filters = list(self._layout.filters)
        if self._share:
            # Retained states are not shared, so that each recorder gets them all in order.
            filters = [*(f"$share/{self._share}/{each}" for each in filters), *self._layout.standing]
        if self._settings.version == "5":
            # Retained messages are sent only at the first connection of a session.
            options = SubscribeOptions(qos=1, retainHandling=1)
            client.subscribe([(each, options) for each in filters])
        else:
            client.subscribe([(each, 1) for each in filters])

    def _on_subscribe(self, client: paho.Client, _: Any, __: Any, codes: Sequence[ReasonCode], ___: Any) -> None:
        if any(code.is_failure for code in codes):
            self._problem = LinkDownError(
                f"broker {self._settings.place} does not let {self._settings.user or 'this client'} subscribe below "
                f"{self._layout.prefix}; allow it in the broker's access control"
            )
            client.disconnect()
            return
        self._connected_s = time.monotonic()
        self._succeeded("broker", f"broker {self._settings.place}")

    def _on_disconnect(self, _: paho.Client, __: Any, ___: Any, code: ReasonCode, ____: Any) -> None:
        if code.value == _TAKEN_OVER:
            self._problem = UsageError(
                f"broker {self._settings.place}: another recorder has started with the same name "
                f"({self._client_id}); give each its own --name"
            )

    def _on_message(self, client: paho.Client, _: Any, message: paho.MQTTMessage) -> None:
        if message.qos == 0 and len(self._waiting) >= UNDER_WAY:
            # Without acknowledgements the broker does not throttle; excess messages are dropped here.
            return
        content: list[Recorded] = []
        try:
            content = list(records_in(self._layout, message.topic, bytes(message.payload)))
        except _UNFIT:
            self.unreadable += 1
        if not self._waiting:
            self._since_s = time.monotonic()
        self._waiting.append(_Waiting(client, message.mid, message.qos, content))
        self._rows += len(content)

    def _lost(self, error: DriveCommError) -> None:
        self._client = None
        if isinstance(error, UsageError):
            raise error
        if isinstance(error, VersionRefused) and self._settings.version == "5" and not self._share:
            # Everything except sharing works the same in both versions.
            self._settings = replace(self._settings, version="3.1.1")
            return
        if isinstance(error, VersionRefused) and self._share:
            raise UsageError(
                f"broker {self._settings.place} does not speak MQTT 5, which sharing the work takes; leave --share out"
            )
        lasted = time.monotonic() - self._connected_s > _LASTED_S
        self._lost_soon = 0 if lasted else self._lost_soon + 1
        if self._lost_soon < _LOST_SOON:
            self._failed("broker", error)
            return
        # Not every broker reports that another client has taken over the client id.
        again = LinkDownError(
            f"broker {self._settings.place}: the connection is repeatedly lost soon after it was made; if "
            f"another recorder uses the same name ({self._client_id}), give each its own --name"
        )
        self._failed("broker", again, _LOST_SOON_PAUSE_S)

    def _disconnect(self) -> None:
        if self._client is not None:
            self._client.disconnect()
            # Sends the remaining output, including acknowledgements.
            self._client.loop(_LOOK_S)

    # Reports

    def _is_due(self, what: str) -> bool:
        return time.monotonic() >= self._pauses[what].over_at

    def _failed(self, what: str, error: DriveCommError, least_s: float = 0.0) -> None:
        self._pauses[what].failed(time.monotonic(), least_s)
        text = in_one_line(error)
        if self._told.get(what) != text:
            self._told[what] = text
            self._tell(f"{text}; it is tried again")

    def _succeeded(self, what: str, name: str) -> None:
        self._pauses[what].succeeded()
        if self._told.pop(what, ""):
            self._tell(f"{name} is connected again")
