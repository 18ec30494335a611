"""An aiomqtt client for high message rates that never blocks other threads; paho still does the protocol work."""

from __future__ import annotations

import asyncio
import socket
from typing import TYPE_CHECKING, Any

import aiomqtt
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.reasoncodes import ReasonCode

from drivecomm.server.broker.buffered import BufferedSocket

if TYPE_CHECKING:
    from paho.mqtt.properties import Properties

IN_FLIGHT = 20
"""Limit of messages without an acknowledgement; the default limit of MQTT brokers."""
WITHIN_S = 10.0
"""Timeout for an acknowledgement of the broker; after it, the connection counts as lost."""
_NO_ANSWER = "the broker did not answer in time"


class BrokerClient(aiomqtt.Client):
    """A client that also notices refusals by the broker, which otherwise look like successful deliveries."""

    def __init__(self, *content: Any, **further: Any) -> None:
        super().__init__(*content, **further)
        self.refusal = ""
        self._room = asyncio.Semaphore(IN_FLIGHT)
        self._is_watching = False
        # By message number, the oldest first: the future for the acknowledgement, and its deadline.
        self._sent: dict[int, tuple[asyncio.Future[Exception | None], float]] = {}
        self._overdue: asyncio.TimerHandle | None = None

    async def hand_over(
        self, topic: str, payload: str | bytes, qos: int, retain: bool, properties: Properties | None
    ) -> asyncio.Future[Exception | None]:
        """Publish a message when there is room; return a future for its delivery.

        The future is done when the message is sent, from QoS 1 on when the broker has acknowledged it. Its result is
        None, or the error. The method of aiomqtt is slower: it waits in a task, searches a list of all waiting
        messages, and waits until the event loop finds the socket writable.
        """
        await self._room.acquire()
        info = self._client.publish(topic, payload, qos, retain, properties)
        if info.rc != MQTTErrorCode.MQTT_ERR_SUCCESS:
            self._room.release()
            raise aiomqtt.MqttCodeError(info.rc, "it could not be published")
        answer: asyncio.Future[Exception | None] = self._loop.create_future()
        self._sent[info.mid] = answer, self._loop.time() + WITHIN_S
        if self._overdue is None:
            self._overdue = self._loop.call_later(WITHIN_S, self._give_up)
        return answer

    def over(self) -> None:
        """Retrieve the error that ended the connection, because asyncio logs unretrieved ones; cancel the timer."""
        if self._overdue is not None:
            self._overdue.cancel()
        if self._disconnected.done() and not self._disconnected.cancelled():
            self._disconnected.exception()

    def _give_up(self) -> None:
        """Fail all messages whose acknowledgement is overdue; one timer serves all messages."""
        now, self._overdue = self._loop.time(), None
        for number, (_, until) in list(self._sent.items()):
            if until > now:
                self._overdue = self._loop.call_at(until, self._give_up)
                return
            self._answered(number, aiomqtt.MqttError(_NO_ANSWER))

    def _answered(self, number: int, error: Exception | None) -> None:
        answer, _ = self._sent.pop(number)
        self._room.release()
        # The waiting task may have gone.
        if not answer.done():
            answer.set_result(error)

    def _on_publish(
        self,
        client: Any,
        userdata: Any,
        mid: int,
        reason_code: Any,
        properties: Any,
    ) -> None:
        if isinstance(reason_code, ReasonCode) and reason_code.is_failure:
            self.refusal = str(reason_code)
        if mid in self._sent:
            self._answered(mid, None)
        else:
            super()._on_publish(client, userdata, mid, reason_code, properties)

    def _on_socket_open(self, client: Any, userdata: Any, sock: Any) -> None:
        # A value must not wait for the acknowledgement of the previous one; aiomqtt sets this on bare sockets only.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client._sock = BufferedSocket(sock)  # noqa: SLF001 - paho has no public way to set a socket
        super()._on_socket_open(client, userdata, client._sock)  # noqa: SLF001 - as above

    def _on_socket_register_write(self, client: Any, userdata: Any, sock: Any) -> None:  # noqa: ARG002 - the signature of aiomqtt
        try:
            asyncio.get_running_loop().call_soon(self._write, client)
        except RuntimeError:
            # Called in the thread that connects, which has no event loop.
            self._loop.call_soon_threadsafe(self._write, client)

    def _on_socket_unregister_write(self, client: Any, userdata: Any, sock: Any) -> None:
        if self._is_watching:
            self._is_watching = False
            super()._on_socket_unregister_write(client, userdata, sock)

    def _write(self, client: Any) -> None:
        """Send all messages published in this turn of the event loop, and the rest when the socket has room."""
        try:
            client.loop_write()
            sock = client.socket()
            if sock is not None and not sock.flush():
                self._is_watching = True
                self._loop.add_writer(sock.fileno(), self._write, client)
        except Exception as error:  # noqa: BLE001 - any error ends the connection
            if not self._disconnected.done():
                self._disconnected.set_exception(error)
