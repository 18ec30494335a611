"""Replacement for asyncua's connections: peers that flood, stall or send garbage are cut off without affecting others.

A method call runs concurrently with later requests of its connection, so that a stop never waits for another call.
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
from drivecomm.server.opcua.active_request import ActiveRequest, current_request
from drivecomm.server.opcua.delay import Delay
from drivecomm.server.opcua.nodes import standard
from drivecomm.server.opcua.values import status

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
    """Request processing of one connection.

    encrypted: whether an unencrypted channel is limited to discovery. stops: whether a node is a stop method. trusted:
    clients that may create a session; None for any.
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
        self._to_client, self._encrypted, self._stops, self._trusted = transport, encrypted, stops, trusted
        self._calls: set[asyncio.Task[None]] = set()
        self._delay = Delay()
        self.came: deque[float] = deque()
        """Arrival times of the messages not served yet, by `time.monotonic`."""
        self._came_s = 0.0

    async def process(self, header: Any, body: Any) -> Any:
        """Serve a message, then pause for as long as it took. Return whether the connection stays open."""
        self._came_s = self.came.popleft()
        began = time.thread_time()
        try:
            goes_on = await super().process(header, body)  # type: ignore[no-untyped-call]
        except Exception:  # noqa: BLE001 - what a client sends is whatever it likes
            _log.debug("a message that cannot be served", exc_info=True)
            return False
        await asyncio.sleep(min(time.thread_time() - began, _LONGEST_PAUSE_S))
        return goes_on and self._limits.max_send_buffer >= limits.SMALLEST_CHUNK

    async def process_message(self, seqhdr: Any, body: Any) -> Any:
        """Serve a request if it is permitted now; a method call runs in its own task."""
        ahead = body.copy()
        kind, header = nodeid_from_binary(ahead), struct_from_binary(ua.RequestHeader, ahead)
        try:
            await self._check(kind, header, ahead)
        except (ServiceError, ua.uaerrors.UaStatusCodeError) as error:
            self._refuse(header, seqhdr, error.code)
            return True
        if kind != _CALL:
            return await super().process_message(seqhdr, body)  # type: ignore[no-untyped-call]
        calls = struct_from_binary(ua.CallParameters, ahead).MethodsToCall or []
        is_stop = all(self._stops(each.MethodId) for each in calls)
        if len(self._calls) >= (limits.STOPS_UNDER_WAY if is_stop else limits.CALLS_UNDER_WAY):
            self._refuse(header, seqhdr, ua.StatusCodes.BadTooManyOperations)
            return True
        task = asyncio.create_task(self._call(seqhdr, body))
        self._calls.add(task)
        task.add_done_callback(self._calls.discard)
        return True

    def send_response(self, requesthandle: Any, seqhdr: Any, response: Any, msgtype: Any = None) -> None:
        """Send a response, and abort the connection of a client that does not read."""
        if self._to_client.is_closing():
            return
        super().send_response(requesthandle, seqhdr, response, msgtype or ua.MessageType.SecureMessage)  # type: ignore[no-untyped-call]
        if self._to_client.get_write_buffer_size() > limits.UNSENT:
            self._to_client.abort()

    async def close(self) -> None:
        """Close the session with its connection; asyncua would keep a session with subscriptions for another one."""
        await super().close()  # type: ignore[no-untyped-call]
        if self.session is not None:
            await self.session.close_session()

    async def _call(self, seqhdr: Any, body: Any) -> None:
        try:
            await super().process_message(seqhdr, body)  # type: ignore[no-untyped-call]
        except Exception:  # noqa: BLE001 - a request is whatever a client makes of it
            self._to_client.abort()

    def _refuse(self, header: ua.RequestHeader, seqhdr: Any, code: int) -> None:
        response = ua.ServiceFault()
        response.ResponseHeader.ServiceResult = status(code)
        self.send_response(header.RequestHandle, seqhdr, response)

    async def _check(self, kind: ua.NodeId, header: ua.RequestHeader, parameters: Buffer) -> None:
        """Raise ServiceError for a request that is not permitted now."""
        if kind in _DISCOVERY:
            return
        # asyncua serves any request on an unopened channel, or on one meant only for discovery.
        policy = self._connection.security_policy
        if not self._connection.is_open() or (self._encrypted and policy.Mode != ua.MessageSecurityMode.SignAndEncrypt):
            raise ServiceError(ua.StatusCodes.BadSecurityModeInsufficient)
        if kind == _CREATE:
            if self.session is not None and not self.session.over:
                raise ServiceError(ua.StatusCodes.BadTooManySessions)
            if self._trusted is not None:
                # The certificate of the channel; the one in the request is not proven to be the client's.
                await self._trusted.check(policy.peer_certificate)
        elif kind == _ACTIVATE:
            if self.session is None:
                raise ServiceError(ua.StatusCodes.BadSessionIdInvalid)
            await self.session.recognise(struct_from_binary(ua.ActivateSessionParameters, parameters.copy()))
        elif kind != _CLOSE:
            self._begin_use(kind, header)

    def _begin_use(self, kind: ua.NodeId, header: ua.RequestHeader) -> None:
        session = self.session
        if session is None or session.over or not session.is_activated():
            raise ServiceError(ua.StatusCodes.BadSessionNotActivated)
        if kind in _WRITES:
            raise ServiceError(ua.StatusCodes.BadUserAccessDenied)
        if kind not in _USES:
            raise ServiceError(ua.StatusCodes.BadServiceUnsupported)
        try:
            session.check()
        except NotAllowedError:
            self._to_client.close()
            raise ServiceError(ua.StatusCodes.BadSessionClosed) from None
        waited_s = self._delay.of(header.Timestamp, self._came_s) + max(0.0, time.monotonic() - self._came_s)
        current_request.set(ActiveRequest(session, waited_s))


class OpcuaConnection(OPCUAProtocol):
    """One connection. encrypted, stops, trusted: see `Processor`."""

    processor: Processor | None
    iserver: DoorServer

    def __init__(
        self, *, encrypted: bool, stops: Callable[[ua.NodeId], bool], trusted: TrustedClients | None, **given: Any
    ) -> None:
        super().__init__(**given)
        self._processor = partial(Processor, encrypted=encrypted, stops=stops, trusted=trusted)
        self._received = b""
        self._since_s = time.monotonic()

    def yields(self, *, to_known: bool) -> tuple[int, float] | None:  # noqa: ARG002 - it is not known who will log in
        """Rank this connection for closing: without login first, then anonymous users; never a named user."""
        session = self.processor.session if self.processor is not None else None
        if session is None or session.over or not session.is_activated():
            return 0, self._since_s
        return (1, self._since_s) if session.caller.name == ANONYMOUS else None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Create the request processing of the connection."""
        super().connection_made(transport)
        if self.transport is not None:
            self.processor = self._processor(self.iserver, self.transport, self.limits)
            self.processor.set_policies(self.policies)  # type: ignore[no-untyped-call]

    def data_received(self, data: bytes) -> None:
        """Split received data into messages. asyncua would buffer a message of any announced size."""
        self._received += data
        while len(self._received) >= _HEADER and self.transport is not None and self.processor is not None:
            size = int.from_bytes(self._received[4:_HEADER], "little")
            if self._received[:3] not in _KINDS or not _HEADER < size <= limits.CHUNK:
                self.transport.abort()
                return
            if len(self._received) < size:
                return
            message, self._received = Buffer(self._received[:size]), self._received[size:]
            try:
                self.messages.put_nowait((header_from_binary(message), message))
            except Exception:  # noqa: BLE001 - whatever is wrong with it, or with how much of it there is
                self.transport.abort()
                return
            self.processor.came.append(time.monotonic())
