"""One connection to a broker, from its beginning to its end; errors of aiomqtt become errors of drivecomm here."""

from __future__ import annotations

import asyncio
import logging
import ssl
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from drivecomm.errors import LinkDownError, PortError, UsageError
from drivecomm.server.broker.client import IN_FLIGHT, WITHIN_S, BrokerClient
from drivecomm.server.broker.settings import VERSIONS

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from drivecomm.server.broker.settings import BrokerSettings

CONNECTING_S = 4.0
"""Time limit for connecting; some networks accept a connection and never answer."""
_TAKEN_OVER = 0x8E
_BAD_VERSION = 0x84
_BAD_IDENTITY = 0x85
_BAD_USERS = frozenset({0x86, 0x87})
_REFUSED_FROM = 0x80

_log = logging.getLogger("drivecomm.server")
# The library logs each message, which would be a flood of its own; important errors are raised.
_of_library = logging.getLogger("drivecomm.server.aiomqtt")
_of_library.setLevel(logging.ERROR)


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerMessage:
    """A message to publish.

    expires_s: seconds after which the broker drops it, if the version of MQTT supports that.
    """

    topic: str
    payload: str | bytes
    qos: int = 1
    retain: bool = False
    expires_s: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceivedMessage:
    """A message of another client.

    retained: published as retained, or sent from the broker's store; MQTT 3.1.1 reports only the latter. answer_to,
    correlation: topic for an answer, and the data that it must carry; only in MQTT 5.
    """

    topic: str
    payload: bytes
    retained: bool = False
    answer_to: str = ""
    correlation: bytes | None = None


class IdentityTakenOver(LinkDownError):  # noqa: N818 - named like LinkDownError, for what happened
    """Another client has connected with the same client id, so the broker has closed this connection."""


class IdentityRefused(PortError):  # noqa: N818 - as above
    """The broker refuses this client id."""


class VersionRefused(PortError):  # noqa: N818 - as above
    """The broker does not support this version of MQTT."""


class PendingMessage:
    """A message on its way to the broker."""

    def __init__(
        self, connection: BrokerConnection, message: BrokerMessage, answer: asyncio.Future[Exception | None]
    ) -> None:
        self._connection, self._message, self._answer = connection, message, answer

    async def arrived(self) -> None:
        """Wait until the broker has the message.

        Raises LinkDownError if it refuses it, or does not acknowledge it in time.
        """
        if (error := await self._answer) is not None:
            raise self._connection.lost_by(error) from error
        self._connection.check_taken(self._message)


class BrokerConnection:
    """An open connection. Methods raise LinkDownError once it is lost."""

    def __init__(self, client: BrokerClient, settings: BrokerSettings) -> None:
        self._client = client
        self._has_properties = settings.version == "5"
        self._settings = settings

    async def publish(self, message: BrokerMessage) -> None:
        """Publish a message; from QoS 1 on, wait until the broker has it."""
        await (await self.hand_over(message)).arrived()

    async def hand_over(self, message: BrokerMessage) -> PendingMessage:
        """Publish a message as soon as there is room, without waiting until the broker has it."""
        return await self._hand_over(message, self._properties_of(message))

    async def _hand_over(self, message: BrokerMessage, properties: Properties | None) -> PendingMessage:
        try:
            answer = await self._client.hand_over(
                message.topic, message.payload, message.qos, message.retain, properties
            )
        except (aiomqtt.MqttError, OSError) as error:
            raise self.lost_by(error) from error
        return PendingMessage(self, message, answer)

    def check_taken(self, message: BrokerMessage) -> None:
        """Raise LinkDownError if the broker has refused a published message."""
        if self._client.refusal:
            raise LinkDownError(
                f"broker {self._settings.place} does not accept what {self._settings.user or 'this client'} publishes, "
                f"such as {message.topic} ({self._client.refusal}); allow it in the broker's access control"
            )

    async def answer(self, received: ReceivedMessage, message: BrokerMessage) -> None:
        """Publish an answer, and also send it to the response topic of the request, with its correlation data."""
        await self.publish(message)
        # Without waiting: a response topic chosen by another client may be refused.
        if received.answer_to and received.answer_to != message.topic:
            properties = Properties(PacketTypes.PUBLISH)
            if received.correlation is not None:
                properties.CorrelationData = received.correlation
            await self._hand_over(BrokerMessage(topic=received.answer_to, payload=message.payload, qos=0), properties)

    async def subscribe(self, *filters: str, qos: int = 1) -> None:
        """Subscribe to messages from now on; with MQTT 5, without those that the broker has retained.

        Raises LinkDownError also if the broker does not permit the subscription.
        """
        options: Any = SubscribeOptions(qos=qos, retainAsPublished=True, retainHandling=2)
        await self._subscribe(filters, options, qos)

    async def subscribe_with_kept(self, *filters: str, qos: int = 1) -> None:
        """Subscribe to messages, including those that the broker has retained."""
        options: Any = SubscribeOptions(qos=qos, retainAsPublished=True, retainHandling=0)
        await self._subscribe(filters, options, qos)

    async def unsubscribe(self, *filters: str) -> None:
        """Unsubscribe from these topics."""
        try:
            await self._client.unsubscribe(list(filters))
        except (aiomqtt.MqttError, OSError) as error:
            raise self.lost_by(error) from error

    async def lost(self) -> None:
        """Wait for the end of the connection.

        Raises LinkDownError then, IdentityTakenOver if another client took its id.
        """
        try:
            # Messages take another path, so this queue stays empty.
            async for _ in self._client.messages:
                pass
        except (aiomqtt.MqttError, OSError) as error:
            raise self.lost_by(error) from error

    async def leave_with_will(self) -> None:
        """Disconnect in order, but let the broker publish the will; do nothing with MQTT 3.1.1, which lacks that."""
        if not self._has_properties:
            return
        reason = ReasonCode(PacketTypes.DISCONNECT, "Disconnect with will message")
        # aiomqtt disconnects without a reason, so this uses paho; the later disconnect of aiomqtt has no effect.
        self._client._client.disconnect(reasoncode=reason)  # noqa: SLF001 - as above
        with suppress(LinkDownError, TimeoutError):
            async with asyncio.timeout(1.0):
                await self.lost()

    async def _subscribe(self, filters: tuple[str, ...], options: SubscribeOptions, qos: int) -> None:
        wanted: Any = (
            [(each, options) for each in filters] if self._has_properties else [(each, qos) for each in filters]
        )
        try:
            granted: Any = await self._client.subscribe(wanted)
        except (aiomqtt.MqttError, OSError) as error:
            raise self.lost_by(error) from error
        for topic, code in zip(filters, granted, strict=False):
            number = code.value if isinstance(code, ReasonCode) else int(code)
            if number >= _REFUSED_FROM:
                raise LinkDownError(
                    f"broker {self._settings.place} does not allow {self._settings.user or 'this client'} to subscribe "
                    f"to {topic}; allow it in the broker's access control"
                )

    def _properties_of(self, message: BrokerMessage) -> Properties | None:
        if message.expires_s is None or not self._has_properties:
            return None
        properties = Properties(PacketTypes.PUBLISH)
        properties.MessageExpiryInterval = message.expires_s
        return properties

    def lost_by(self, error: BaseException) -> LinkDownError:
        """Return the error of drivecomm for an error of the library."""
        place, each = self._settings.place, error
        while each is not None:
            code = getattr(each, "rc", None)
            if isinstance(code, ReasonCode) and code.value == _TAKEN_OVER:
                return IdentityTakenOver(f"broker {place}: another client has the same client id")
            each = each.__cause__  # type: ignore[assignment]
        return LinkDownError(f"broker {place}: the connection was lost: {error}")


@asynccontextmanager
async def connect_to_broker(
    settings: BrokerSettings,
    client_id: str,
    received: Callable[[ReceivedMessage], None],
    will: BrokerMessage | None = None,
) -> AsyncIterator[BrokerConnection]:
    """Connect to a broker for the duration of the block.

    received: called with each message in the event loop; must be quick. Raises PortError if the broker cannot be
    reached or refuses (IdentityRefused, VersionRefused), and UsageError for unusable passwords and certificates.
    """
    client = BrokerClient(
        settings.host,
        settings.port,
        identifier=client_id,
        username=settings.user or None,
        password=settings.password() if settings.password else None,
        protocol=aiomqtt.ProtocolVersion.V5 if settings.version == "5" else aiomqtt.ProtocolVersion.V311,
        # Messages sent while this client was away are outdated.
        **({"clean_start": True} if settings.version == "5" else {"clean_session": True}),
        keepalive=settings.keep_alive_s,
        will=None if will is None else aiomqtt.Will(will.topic, will.payload, will.qos, will.retain),
        tls_context=tls_context(settings) if settings.tls else None,
        timeout=CONNECTING_S,
        max_inflight_messages=IN_FLIGHT,
        max_concurrent_outgoing_calls=IN_FLIGHT,
        queue_type=_handing_to(received),
        logger=_of_library,
    )
    try:
        await client.__aenter__()
    except (aiomqtt.MqttError, OSError) as error:
        raise refusal(settings, client_id, error) from error
    client.timeout = WITHIN_S
    try:
        yield BrokerConnection(client, settings)
    finally:
        try:
            await client.__aexit__(None, None, None)
        except (aiomqtt.MqttError, OSError) as error:
            _of_library.debug("leaving %s: %s", settings.place, error)
        client.over()


def _handing_to(received: Callable[[ReceivedMessage], None]) -> type[asyncio.Queue[aiomqtt.Message]]:
    class Straight(asyncio.Queue[aiomqtt.Message]):
        """A queue that passes each message on immediately, so that none waits behind others and none pile up."""

        def put_nowait(self, item: aiomqtt.Message) -> None:
            try:
                received(_received(item))
            except Exception:  # noqa: BLE001 - an unreadable message must not end the connection
                _log.exception("message on %s", item.topic)

    return Straight


def _received(message: aiomqtt.Message) -> ReceivedMessage:
    return ReceivedMessage(
        topic=str(message.topic),
        payload=bytes(message.payload or b""),
        retained=message.retain,
        answer_to=getattr(message.properties, "ResponseTopic", ""),
        correlation=getattr(message.properties, "CorrelationData", None),
    )


def refusal(settings: BrokerSettings, client_id: str, error: BaseException) -> PortError:
    """Return the error for a connection that was refused or got no reply."""
    place, code = settings.place, getattr(error, "rc", None)
    text = f"broker {place} cannot be reached: {error or type(error).__name__}"
    if isinstance(code, ReasonCode):
        if code.value == _BAD_IDENTITY:
            return IdentityRefused(f"broker {place} refuses the client id {client_id}; write another client_id =")
        if code.value == _BAD_VERSION:
            other = next(each for each in VERSIONS if each != settings.version)
            return VersionRefused(
                f'broker {place} does not speak MQTT {settings.version}; write version = "{other}" if it speaks that'
            )
        question = "; is user = right?" if code.value in _BAD_USERS else ""
        text = f"broker {place} refuses {settings.user or 'a client without a user'}: {code}{question}"
    return PortError(text)


def tls_context(settings: BrokerSettings) -> ssl.SSLContext:
    """Return the TLS settings for a broker, with the client's certificate. Raises UsageError for unusable files."""
    files = [str(each) for each in (settings.authority, settings.certificate, settings.key) if each is not None]
    try:
        context = ssl.create_default_context(cafile=settings.authority)
        if settings.certificate is not None:
            context.load_cert_chain(settings.certificate, settings.key)
    except OSError as error:
        raise UsageError(f"broker {settings.place}: {' and '.join(files)} cannot be used: {error}") from error
    return context
