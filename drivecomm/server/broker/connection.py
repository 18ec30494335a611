"""One connection to a broker, from its beginning to its end; what aiomqtt raises becomes an error of drivecomm here."""

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
from drivecomm.server.broker.client import IN_FLIGHT, WITHIN_S, Client
from drivecomm.server.broker.settings import VERSIONS

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from drivecomm.server.broker.settings import BrokerSettings

CONNECTING_S = 4.0
"""How long it may take to let a client in; one that is behind a gate that nobody answers is tried again."""
_TAKEN_OVER = 0x8E
_BAD_VERSION = 0x84
_BAD_IDENTITY = 0x85
_BAD_USERS = frozenset({0x86, 0x87})
_REFUSED_FROM = 0x80

_log = logging.getLogger("drivecomm.server")
# What it tells of each message of a flood would be a flood of its own; what matters is raised.
_of_library = logging.getLogger("drivecomm.server.aiomqtt")
_of_library.setLevel(logging.ERROR)


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """What is published. expires_s: the broker forgets it after so long, where the version of MQTT has that."""

    topic: str
    payload: str | bytes
    qos: int = 1
    retain: bool = False
    expires_s: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Received:
    """What others have published. retained: as it was published, or kept by the broker; 3.1.1 tells only the latter.

    answer_to, correlation: where an answer is wanted, and what it shall carry; MQTT 5 has them.
    """

    topic: str
    payload: bytes
    retained: bool = False
    answer_to: str = ""
    correlation: bytes | None = None


class IdentityTakenOver(LinkDownError):  # noqa: N818 - says what happened, beside LinkDownError
    """Somebody else has connected with the same client id, and the broker has cut this connection for it."""


class IdentityRefused(PortError):  # noqa: N818 - as above
    """The broker takes nobody with this client id."""


class VersionRefused(PortError):  # noqa: N818 - as above
    """The broker does not speak this version of MQTT."""


class Sent:
    """A message on its way to the broker."""

    def __init__(self, connection: Connection, message: Message, answer: asyncio.Future[Exception | None]) -> None:
        self._connection, self._message, self._answer = connection, message, answer

    async def arrived(self) -> None:
        """Wait until the broker has it. Raises LinkDownError where it refuses it, or does not say so in time."""
        if (error := await self._answer) is not None:
            raise self._connection.lost_by(error) from error
        self._connection.check_taken(self._message)


class Connection:
    """A connection that is open. Methods raise LinkDownError when it is not any more."""

    def __init__(self, client: Client, settings: BrokerSettings) -> None:
        self._client = client
        self._has_properties = settings.version == "5"
        self._settings = settings

    async def publish(self, message: Message) -> None:
        """Publish a message; from QoS 1 on, wait until the broker has it."""
        await (await self.hand_over(message)).arrived()

    async def hand_over(self, message: Message) -> Sent:
        """Publish a message as soon as there is room for it, and do not wait until the broker has it."""
        return await self._hand_over(message, self._properties_of(message))

    async def _hand_over(self, message: Message, properties: Properties | None) -> Sent:
        try:
            answer = await self._client.hand_over(
                message.topic, message.payload, message.qos, message.retain, properties
            )
        except (aiomqtt.MqttError, OSError) as error:
            raise self.lost_by(error) from error
        return Sent(self, message, answer)

    def check_taken(self, message: Message) -> None:
        """Raise LinkDownError where the broker has refused what was published."""
        if self._client.refusal:
            raise LinkDownError(
                f"broker {self._settings.place} does not take what {self._settings.user or 'this client'} publishes, "
                f"such as {message.topic} ({self._client.refusal}); allow it in the broker's access control"
            )

    async def answer(self, received: Received, message: Message) -> None:
        """Publish an answer, and once more where whoever asked wants it, with what they recognise it by."""
        await self.publish(message)
        # Nobody waits whether a topic that somebody else has chosen takes it.
        if received.answer_to and received.answer_to != message.topic:
            properties = Properties(PacketTypes.PUBLISH)
            if received.correlation is not None:
                properties.CorrelationData = received.correlation
            await self._hand_over(Message(topic=received.answer_to, payload=message.payload, qos=0), properties)

    async def subscribe(self, *filters: str, qos: int = 1) -> None:
        """Want what is published from now on; what the broker kept is left out where MQTT 5 is spoken.

        Raises LinkDownError where the broker does not let this client have it, too.
        """
        options: Any = SubscribeOptions(qos=qos, retainAsPublished=True, retainHandling=2)
        await self._subscribe(filters, options, qos)

    async def subscribe_with_kept(self, *filters: str, qos: int = 1) -> None:
        """Want what the broker has kept, too."""
        options: Any = SubscribeOptions(qos=qos, retainAsPublished=True, retainHandling=0)
        await self._subscribe(filters, options, qos)

    async def unsubscribe(self, *filters: str) -> None:
        """Want it no more."""
        try:
            await self._client.unsubscribe(list(filters))
        except (aiomqtt.MqttError, OSError) as error:
            raise self.lost_by(error) from error

    async def lost(self) -> None:
        """Wait until it is over. Raises LinkDownError then; IdentityTakenOver where somebody else has its client id."""
        try:
            # Messages go another way, so that nothing comes here.
            async for _ in self._client.messages:
                pass
        except (aiomqtt.MqttError, OSError) as error:
            raise self.lost_by(error) from error

    async def leave_with_will(self) -> None:
        """Leave in order, and have the broker publish the will all the same; 3.1.1 has no way to ask for that."""
        if not self._has_properties:
            return
        reason = ReasonCode(PacketTypes.DISCONNECT, "Disconnect with will message")
        # aiomqtt leaves without a reason; what it does afterwards finds nobody there.
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

    def _properties_of(self, message: Message) -> Properties | None:
        if message.expires_s is None or not self._has_properties:
            return None
        properties = Properties(PacketTypes.PUBLISH)
        properties.MessageExpiryInterval = message.expires_s
        return properties

    def lost_by(self, error: BaseException) -> LinkDownError:
        """Return what an error of the library means."""
        place, each = self._settings.place, error
        while each is not None:
            code = getattr(each, "rc", None)
            if isinstance(code, ReasonCode) and code.value == _TAKEN_OVER:
                return IdentityTakenOver(f"broker {place}: another client has the same client id")
            each = each.__cause__  # type: ignore[assignment]
        return LinkDownError(f"broker {place}: the connection was lost: {error}")


@asynccontextmanager
async def connected(
    settings: BrokerSettings, client_id: str, received: Callable[[Received], None], will: Message | None = None
) -> AsyncIterator[Connection]:
    """Connect with a broker for the time of the block. received: hears each message in the event loop, and is quick.

    Raises PortError where that cannot be, IdentityRefused among them, and UsageError for passwords and certificates
    that cannot be used.
    """
    client = Client(
        settings.host,
        settings.port,
        identifier=client_id,
        username=settings.user or None,
        password=settings.password() if settings.password else None,
        protocol=aiomqtt.ProtocolVersion.V5 if settings.version == "5" else aiomqtt.ProtocolVersion.V311,
        # Whatever was sent while nobody was there is void.
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
        yield Connection(client, settings)
    finally:
        try:
            await client.__aexit__(None, None, None)
        except (aiomqtt.MqttError, OSError) as error:
            _of_library.debug("leaving %s: %s", settings.place, error)
        client.over()


def _handing_to(received: Callable[[Received], None]) -> type[asyncio.Queue[aiomqtt.Message]]:
    class Straight(asyncio.Queue[aiomqtt.Message]):
        """Hands each message over as it comes, so that none waits behind others, and nothing piles up."""

        def put_nowait(self, item: aiomqtt.Message) -> None:
            try:
                received(_received(item))
            except Exception:  # noqa: BLE001 - a message that we cannot handle costs the connection nothing
                _log.exception("message on %s", item.topic)

    return Straight


def _received(message: aiomqtt.Message) -> Received:
    return Received(
        topic=str(message.topic),
        payload=bytes(message.payload or b""),
        retained=message.retain,
        answer_to=getattr(message.properties, "ResponseTopic", ""),
        correlation=getattr(message.properties, "CorrelationData", None),
    )


def refusal(settings: BrokerSettings, client_id: str, error: BaseException) -> PortError:
    """Return what it means that a connection was refused, or not answered at all."""
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
    """Return how a broker is recognised, and who the client is to it. Raises UsageError for files of no use."""
    files = [str(each) for each in (settings.authority, settings.certificate, settings.key) if each is not None]
    try:
        context = ssl.create_default_context(cafile=settings.authority)
        if settings.certificate is not None:
            context.load_cert_chain(settings.certificate, settings.key)
    except OSError as error:
        raise UsageError(f"broker {settings.place}: {' and '.join(files)} cannot be used: {error}") from error
    return context
