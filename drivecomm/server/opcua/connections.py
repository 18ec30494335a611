"""Connections in place of asyncua's own: who floods, stalls or sends garbage is cut off, and costs the others nothing.

A call is served beside what else a connection asks, so that a stop waits for no other call of its client.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import Buffer, ServiceError
from asyncua.server.binary_server_asyncio import OPCUAProtocol
from asyncua.server.uaprocessor import UaProcessor
from asyncua.ua.ua_binary import header_from_binary, nodeid_from_binary, struct_from_binary

from drivecomm.errors import NotAllowedError
from drivecomm.server import ANONYMOUS
from drivecomm.server.opcua import limits
from drivecomm.server.opcua.asking import Asking, asking
from drivecomm.server.opcua.delay import Delay
from drivecomm.server.opcua.nodes import standard

if TYPE_CHECKING:
    from collections.abc import Callable

    from asyncua.common.connection import TransportLimits

    from drivecomm.server.opcua.sessions import DoorServer, DoorSession
    from drivecomm.server.opcua.trusted import TrustedClients

_log = logging.getLogger("drivecomm.server")

_KINDS = frozenset({b"HEL", b"OPN", b"MSG", b"CLO"})
_HEADER = 8
_LONGEST_PAUSE_S = 0.1


def _requests(*names: str) -> frozenset[ua.NodeId]:
    return frozenset(standard(getattr(ua.ObjectIds, f"{name}Request_Encoding_DefaultBinary")) for name in names)


_DISCOVERY = _requests("GetEndpoints", "FindServers")
_CREATE, _ACTIVATE, _CLOSE, _CALL = (
    next(iter(_requests(name))) for name in ("CreateSession", "ActivateSession", "CloseSession", "Call")
)
_USES = _requests(
    "Read", "Write", "Browse", "TranslateBrowsePathsToNodeIds", "RegisterNodes", "UnregisterNodes", "HistoryRead",
    "Call",
    "CreateSubscription", "ModifySubscription", "DeleteSubscriptions", "SetPublishingMode", "Publish", "Republish",
    "TransferSubscriptions",
    "CreateMonitoredItems", "ModifyMonitoredItems", "DeleteMonitoredItems", "SetMonitoringMode",
)  # fmt: skip
_WRITES = _requests("HistoryUpdate", "AddNodes", "DeleteNodes", "AddReferences", "DeleteReferences")


class Processor(UaProcessor):
    """Serves the requests of one connection. encrypted: nothing but discovery is served on a channel that is not.

    stops: whether a node is a method that stops. trusted: whose clients may begin a session, None for any.
    """

    iserver: DoorServer
    session: DoorSession | None

    def __init__(
        self,
        server: DoorServer,
        transport: asyncio.Transport,
        sizes: TransportLimits,
        *,
        encrypted: bool,
        stops: Callable[[ua.NodeId], bool],
        trusted: TrustedClients | None,
    ) -> None:
        super().__init__(server, transport, sizes)
        self._encrypted, self._stops, self._trusted = encrypted, stops, trusted
        self._calls: set[asyncio.Task[None]] = set()
        self._delay = Delay()
        self.came_s = 0.0
        """When the message that is being served had come, by `time.monotonic`."""

    async def process(self, header: Any, body: Any) -> Any:
        """Serve a message; returns whether the connection goes on."""
        goes_on = await super().process(header, body)  # type: ignore[no-untyped-call]
        return goes_on and self._limits.max_send_buffer >= limits.SMALLEST_CHUNK

    async def process_message(self, seqhdr: Any, body: Any) -> Any:
        """Serve a request; a call beside what follows it."""
        if nodeid_from_binary(body.copy()) != _CALL:
            return await super().process_message(seqhdr, body)  # type: ignore[no-untyped-call]
        most = limits.STOPS_UNDER_WAY if self._is_stop(body.copy()) else limits.CALLS_UNDER_WAY
        if len(self._calls) >= most:
            self._refuse(seqhdr, body, ua.StatusCodes.BadTooManyOperations)
            return True
        task = asyncio.create_task(self._call(seqhdr, body))
        self._calls.add(task)
        task.add_done_callback(self._calls.discard)
        return True

    def send_response(self, requesthandle: Any, seqhdr: Any, response: Any, msgtype: Any = None) -> None:
        """Answer; who does not read what they have asked for is cut off."""
        if self._transport.is_closing():
            return
        super().send_response(requesthandle, seqhdr, response, msgtype or ua.MessageType.SecureMessage)  # type: ignore[no-untyped-call]
        if self._transport.get_write_buffer_size() > limits.UNSENT:
            self._transport.abort()

    async def _call(self, seqhdr: Any, body: Any) -> None:
        try:
            await super().process_message(seqhdr, body)  # type: ignore[no-untyped-call]
        except Exception:  # noqa: BLE001 - a request is whatever a client makes of it
            self._transport.abort()

    def _is_stop(self, body: Buffer) -> bool:
        nodeid_from_binary(body)
        struct_from_binary(ua.RequestHeader, body)
        calls = struct_from_binary(ua.CallParameters, body).MethodsToCall or []
        return all(self._stops(each.MethodId) for each in calls)

    def _refuse(self, seqhdr: Any, body: Any, code: int) -> None:
        nodeid_from_binary(body)
        header = struct_from_binary(ua.RequestHeader, body)
        response = ua.ServiceFault()
        response.ResponseHeader.ServiceResult = ua.StatusCode(ua.UInt32(code))
        self.send_response(header.RequestHandle, seqhdr, response)

    async def _process_message(self, typeid: Any, requesthdr: Any, seqhdr: Any, body: Any) -> Any:
        """Serve a request that this connection may make now. Raises ServiceError for others."""
        if typeid in _DISCOVERY:
            return await super()._process_message(typeid, requesthdr, seqhdr, body)  # type: ignore[no-untyped-call]
        # asyncua serves whatever comes on a channel that nobody has opened, or that only discovery is meant for.
        policy = self._connection.security_policy
        if not self._connection.is_open() or (self._encrypted and policy.Mode != ua.MessageSecurityMode.SignAndEncrypt):
            raise ServiceError(ua.StatusCodes.BadSecurityModeInsufficient)
        if typeid == _CREATE:
            if self.session is not None and not self.session.over:
                raise ServiceError(ua.StatusCodes.BadTooManySessions)
            if self._trusted is not None:
                # What the channel is signed with: the certificate that comes with the request may be another's.
                await self._trusted.check(policy.peer_certificate)
        elif typeid == _ACTIVATE:
            if self.session is None:
                raise ServiceError(ua.StatusCodes.BadSessionIdInvalid)
            await self.session.recognise(struct_from_binary(ua.ActivateSessionParameters, body.copy()))
        elif typeid != _CLOSE:
            self._begin_use(typeid, requesthdr)
        return await super()._process_message(typeid, requesthdr, seqhdr, body)  # type: ignore[no-untyped-call]

    def _begin_use(self, typeid: Any, requesthdr: Any) -> None:
        session = self.session
        if session is None or session.over or not session.is_activated():
            raise ServiceError(ua.StatusCodes.BadSessionNotActivated)
        if typeid in _WRITES:
            raise ServiceError(ua.StatusCodes.BadUserAccessDenied)
        if typeid not in _USES:
            raise ServiceError(ua.StatusCodes.BadServiceUnsupported)
        try:
            session.check()
        except NotAllowedError:
            self._transport.close()
            raise ServiceError(ua.StatusCodes.BadSessionClosed) from None
        waited_s = self._delay.of(requesthdr.Timestamp, self.came_s) + max(0.0, time.monotonic() - self.came_s)
        asking.set(Asking(session, waited_s))

    def _should_close_session_on_transport_loss(self) -> bool:
        return self.session is not None


class Connection(OPCUAProtocol):
    """One connection. encrypted, stops, trusted: as of `Processor`."""

    processor: Processor | None
    iserver: DoorServer

    def __init__(
        self, *, encrypted: bool, stops: Callable[[ua.NodeId], bool], trusted: TrustedClients | None, **given: Any
    ) -> None:
        super().__init__(**given)
        self._processor = partial(Processor, encrypted=encrypted, stops=stops, trusted=trusted)
        self._came: deque[float] = deque()
        self._since_s = time.monotonic()

    def yields(self, *, to_known: bool) -> tuple[int, float] | None:  # noqa: ARG002 - it is not known who will log in
        """Close those first on which nobody has logged in, then those of anonymous users; never a user's."""
        session = self.processor.session if self.processor is not None else None
        if session is None or session.over or not session.is_activated():
            return 0, self._since_s
        return (1, self._since_s) if session.caller.name == ANONYMOUS else None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        super().connection_made(transport)
        if self.transport is not None:
            self.processor = self._processor(self.iserver, self.transport, self.limits)
            self.processor.set_policies(self.policies)  # type: ignore[no-untyped-call]

    def data_received(self, data: bytes) -> None:
        """Take what has come. asyncua would wait for as much as a message claims to have, in memory."""
        self._buffer += data
        while len(self._buffer) >= _HEADER and self.transport is not None:
            size = int.from_bytes(self._buffer[4:_HEADER], "little")
            if self._buffer[:3] not in _KINDS or not _HEADER < size <= limits.CHUNK:
                self.transport.abort()
                return
            if len(self._buffer) < size:
                return
            message, self._buffer = Buffer(self._buffer[:size]), self._buffer[size:]
            try:
                self.messages.put_nowait((header_from_binary(message), message))
            except Exception:  # noqa: BLE001 - whatever is wrong with it, or with how much of it there is
                self.transport.abort()
                return
            self._came.append(time.monotonic())

    async def _process_received_message_loop(self) -> None:
        """Serve one message after the other; after each as much time is the others' as it took."""
        while True:
            header, message = await self.messages.get()
            if header is None or self.processor is None or self.transport is None:
                return
            self.processor.came_s = self._came.popleft()
            began = time.thread_time()
            try:
                goes_on = await self.processor.process(header, message)
            except Exception:  # noqa: BLE001 - what a client sends is whatever it likes
                _log.debug("a message that cannot be served", exc_info=True)
                goes_on = False
            if not goes_on:
                self.transport.close()
                return
            await asyncio.sleep(min(time.thread_time() - began, _LONGEST_PAUSE_S))

    async def _activation_watchdog(self) -> None:
        """Close a connection on which nobody is logged in for a while."""
        while self.transport is not None and not self.transport.is_closing():
            await asyncio.sleep(limits.WITHOUT_SESSION_S)
            session = self.processor.session if self.processor is not None else None
            if session is None or session.over or not session.is_activated():
                self.transport.abort()
                return
