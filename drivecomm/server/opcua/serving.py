"""The service of the door: keeps the address space up to date and serves it until cancelled."""

from __future__ import annotations

import asyncio
import logging
import socket
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from asyncua import Server, ua
from asyncua.common.connection import TransportLimits
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from drivecomm.errors import NotAllowedError, UsageError
from drivecomm.server import Acceptor, run_concurrently
from drivecomm.server.opcua import limits
from drivecomm.server.opcua.conditions import AlarmConditions
from drivecomm.server.opcua.connections import OpcuaConnection
from drivecomm.server.opcua.events import Events
from drivecomm.server.opcua.history_reader import PastReader
from drivecomm.server.opcua.locks import Locks
from drivecomm.server.opcua.logging_in import LoggingIn
from drivecomm.server.opcua.metadata import NAMESPACE, describe
from drivecomm.server.opcua.methods import Methods
from drivecomm.server.opcua.naming import part
from drivecomm.server.opcua.nodes import Nodes
from drivecomm.server.opcua.sessions import DoorServer
from drivecomm.server.opcua.tree import PlantTree
from drivecomm.server.opcua.trusted import certificates_in

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from drivecomm.server import Bounds, ChangeStream, CurrentValue, ServedPlant
    from drivecomm.server.opcua.trusted import TrustedClients

_TAKEN_EVERY_S = 0.015
"""Maximum delay of a change in seconds, in addition to the client's publishing interval."""
_LOOK_S = 0.5
_TOGETHER = 200
"""Values processed before the event loop gets a turn."""
_END_S = 1.0

_PLAIN = (ua.SecurityPolicyType.NoSecurity,)
_ENCRYPTED = (
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
)


class OpcuaService:
    """Server of an open door. name: name of the door. anonymous: whether anonymous clients may read."""

    def __init__(self, plant: ServedPlant, name: str, *, anonymous: bool) -> None:
        self.plant = plant
        self.locks = Locks(plant)
        self._tree: PlantTree | None = None
        self.server = DoorServer(
            LoggingIn(plant.users, name, anonymous=anonymous),
            PastReader(plant.history, self._value_at, lambda node: node in self.server.aspace),
            self.locks.session_ended,
        )
        self.clients: list[OpcuaConnection] = []
        self.closing: list[asyncio.Task[None]] = []

    @property
    def tree(self) -> PlantTree:
        """Nodes of the plant."""
        assert self._tree is not None  # noqa: S101 - made before anybody is let in
        return self._tree

    def _value_at(self, node: ua.NodeId) -> tuple[str, str] | None:
        return self.tree.value_at(node)

    def _drive_at(self, node: ua.NodeId) -> str | None:
        return self.tree.drive_at(node)

    async def build(self, place: str, certificate: Certificate | None) -> Server:
        """Build the address space; return the asyncua server."""
        # Otherwise any host that reaches the port could fill our log through asyncua.
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        server = Server(iserver=self.server)
        server.name = "drivecomm"
        server.manufacturer_name = "drivecomm"
        server.product_uri = "urn:drivecomm"
        server.application_type = ua.ApplicationType.Server
        server.set_endpoint(f"opc.tcp://{place}/")
        if certificate is not None:
            self.server.certificate, self.server.private_key = certificate
        server.set_security_policy(list(_PLAIN if certificate is None else _ENCRYPTED))
        await server.init()
        await server.set_application_uri(_application_uri(self.plant.name, certificate))
        await server._setup_server_nodes()  # noqa: SLF001 - `start` would also listen, on a port of its own
        nodes = Nodes(self.server.aspace, await server.register_namespace(NAMESPACE))
        self.methods = Methods(self.plant, nodes, self.locks, self._drive_at)
        self._tree = PlantTree(self.plant, nodes, self.methods)
        self.events = Events(self._tree, nodes, self.server.subscription_service, self._tree.types.event)
        self.conditions = AlarmConditions(self.plant, nodes, self._tree, self.events)
        self.conditions.link(self.server.isession)
        await describe(server, nodes, has_history=self.plant.history is not None)
        await self.tree.sync()
        await self.conditions.sync()
        return server

    async def follow(self, changes: ChangeStream) -> None:
        """Publish changes of the plant."""
        async for values, events in changes:
            await self.tree.sync()
            for some in _parts(values):
                await self.tree.take(some)
                await asyncio.sleep(0)
            for event in events:
                await self.events.tell_happened(event)
            if any(event.alarm for event in events):
                await self.conditions.sync(events)

    async def look(self) -> None:
        """Update values that change with time alone, and disconnect users whose access has ended."""
        while True:
            await asyncio.sleep(_LOOK_S)
            await self.tree.sync()
            await self.tree.look()
            await self.conditions.sync()
            self.closing[:] = [task for task in self.closing if not task.done()]
            for client in list(self.clients):
                session = client.processor.session if client.processor is not None else None
                if session is None or client.transport is None:
                    continue
                try:
                    if session.over:
                        client.transport.close()
                    elif session.is_activated():
                        session.check()
                except NotAllowedError:
                    client.transport.abort()

    async def end(self) -> None:
        """Disconnect all clients and release their resources."""
        for client in list(self.clients):
            if client.transport is not None:
                client.transport.abort()
        # Lost connections are processed in the next iteration of the event loop.
        await asyncio.sleep(0)
        if self.closing:
            await asyncio.wait(self.closing, timeout=_END_S)
        self.server.method_service.stop()
        if self.server.time_task is not None:
            self.server.time_task.cancel()


async def serve(
    door: OpcuaService,
    opened: Callable[[], None],
    listening: socket.socket,
    place: str,
    *,
    certificate: Certificate | None,
    trusted: TrustedClients | None,
    bounds: Bounds,
) -> None:
    """Serve until cancelled. place: address and port as announced to clients.

    trusted: see `Processor`. bounds: see `Acceptor`.
    """
    changes = door.plant.changes(_TAKEN_EVERY_S)
    try:
        server = await door.build(place, certificate)
        await door.server.start()
        connection = partial(
            OpcuaConnection,
            iserver=door.server,
            policies=server._policies,  # noqa: SLF001 - made with the endpoints
            clients=door.clients,
            closing_tasks=door.closing,
            limits=TransportLimits(
                max_recv_buffer=limits.CHUNK,
                max_send_buffer=limits.CHUNK,
                max_chunk_count=limits.MESSAGE // limits.SMALLEST_CHUNK,
                max_message_size=limits.MESSAGE,
            ),
            encrypted=certificate is not None,
            stops=door.methods.stops,
            trusted=trusted,
        )
        opened()
        accepting = Acceptor(bounds, lambda _: connection()).run(listening)
        await run_concurrently(accepting, door.follow(changes), door.look())
    finally:
        changes.close()
        with suppress(Exception):
            await door.end()


class Certificate(NamedTuple):
    """Certificate of a server. key: its private key, from the package cryptography."""

    shown: x509.Certificate
    key: Any


def read_certificate(door: str, certificate: Path, key: Path) -> Certificate:
    """Return a certificate and its key from two files.

    door: name of the door. Raises UsageError if the files do not hold a certificate and its key.
    """
    try:
        shown = certificates_in(certificate)[0]
        private = load_pem_private_key(key.read_bytes(), password=None)
    except (OSError, ValueError, TypeError) as error:
        raise UsageError(f"{door}: {certificate} and {key} cannot be used: {error}") from error
    if shown.public_key() != private.public_key():
        raise UsageError(f"{door}: {key} is not the key of {certificate}")
    return Certificate(shown, private)


def _application_uri(plant: str, certificate: Certificate | None) -> str:
    """Return the application URI: that of the certificate if it has one, because clients compare both."""
    if certificate is not None:
        with suppress(x509.ExtensionNotFound, ValueError):
            names = certificate.shown.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
            uris = names.get_values_for_type(x509.UniformResourceIdentifier)
            if uris:
                return str(uris[0])
    return f"urn:{socket.gethostname()}:drivecomm:{part(plant).replace(' ', '-')}"


def _parts(values: Sequence[CurrentValue]) -> Iterator[Sequence[CurrentValue]]:
    for begin in range(0, len(values), _TOGETHER):
        yield values[begin : begin + _TOGETHER]
