"""Replacement for asyncua's sessions: limited, restricted to their own subscriptions, and tied to a user.

asyncua numbers its sessions and allows any connection that knows a number to continue the session. It also allows
sessions to delete and take over each other's subscriptions. Here a session ends with its connection.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.user_managers import UserManager

from drivecomm.server import ANONYMOUS, Caller, Role
from drivecomm.server.opcua import limits
from drivecomm.server.opcua.subscriptions import Subscriptions
from drivecomm.server.opcua.values import status

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Collection, Iterable, Sequence

    from drivecomm.server.opcua.history_reader import PastReader
    from drivecomm.server.opcua.logging_in import LoggingIn
    from drivecomm.server.opcua.monitored import Items

_ELEMENT = 100
"""Estimated bytes of an array element; no array has long texts."""

_NOBODYS = 0
"""Subscription id that never exists."""

_EVERYBODY = User(role=UserRole.User)
"""User as which asyncua treats every client: never as its administrator."""


class DoorServer(InternalServer):
    """asyncua server with our sessions and subscriptions. ended: called with each session that has ended."""

    subscription_service: Subscriptions

    def __init__(
        self, logging_in: LoggingIn, past: PastReader, ended: Callable[[DoorSession], Awaitable[None]]
    ) -> None:
        super().__init__(user_manager=_Nobody())
        self.allow_remote_admin = False
        self.min_session_timeout_ms = limits.SHORTEST_SESSION_MS
        self.max_session_timeout_ms = limits.LONGEST_SESSION_MS
        self.max_unacked_messages_per_subscription = limits.UNACKNOWLEDGED
        self.max_monitored_item_queue_size = limits.QUEUED_VALUES
        self.max_pending_messages_per_connection = limits.WAITING_MESSAGES
        # `Acceptor` enforces the limit; connections that it has just closed still count here.
        self.max_connections = 2 * limits.CONNECTIONS.most
        self.max_subscriptions = limits.SUBSCRIPTIONS
        self.max_pending_activation_seconds = limits.WITHOUT_SESSION_S
        self.logging_in, self.past, self.ended = logging_in, past, ended
        self.subscription_service = Subscriptions(self.aspace, iserver=self)
        self.isession.subscription_service = self.subscription_service
        self.supported_tokens = logging_in.tokens  # type: ignore[assignment]

    def create_session(self, name: str, user: User = _EVERYBODY, external: bool = False) -> InternalSession:
        """Return a session for a connection."""
        if not external:
            return super().create_session(name, user, external)
        return DoorSession(self, name)

    def lookup_external_session(self, auth_token: ua.NodeId) -> InternalSession | None:  # noqa: ARG002
        """Prevent another connection from continuing a session."""
        return None

    def register_external_session(self, session: InternalSession) -> None:
        """Store no session, because none is looked up."""


class _Nobody(UserManager):
    """User manager for asyncua, used after `DoorSession` has authenticated the user."""

    def get_user(self, iserver: InternalServer, *_: object, **__: object) -> User:  # noqa: ARG002
        return _EVERYBODY


class DoorSession(InternalSession):
    """Session of one connection."""

    iserver: DoorServer
    subscription_service: Subscriptions

    def __init__(self, server: DoorServer, name: str) -> None:
        super().__init__(server, server.aspace, server.subscription_service, name, _EVERYBODY, external=True)
        self.client = ""
        self.over = False
        self._token = ""
        self._caller = Caller(name=ANONYMOUS, role=Role.NOBODY, door="opcua")

    @property
    def caller(self) -> Caller:
        """The logged-in caller."""
        return self._caller

    async def create_session(self, params: ua.CreateSessionParameters, sockname: Any = None) -> ua.CreateSessionResult:
        """Create the session."""
        description = params.ClientDescription
        said = (description.ApplicationName.Text if description and description.ApplicationName else "") or ""
        self.client = str(said)[:100]
        return await super().create_session(params, sockname)

    async def recognise(self, params: ua.ActivateSessionParameters) -> None:
        """Authenticate the user. Raises ServiceError if that fails."""
        if self.over:
            raise ServiceError(ua.StatusCodes.BadSessionIdInvalid)
        server = self.iserver
        caller, token = await server.logging_in.recognise(self, params.UserIdentityToken)
        if self.is_activated() and caller.name != self._caller.name:
            # One user cannot continue the session of another.
            raise ServiceError(ua.StatusCodes.BadIdentityTokenRejected)
        before, self._token = self._token, token
        self._caller = caller
        server.logging_in.log_out(before)

    def check(self) -> None:
        """Raise NotAllowedError if the access of the user has ended."""
        self._caller = self.iserver.logging_in.still(self._caller, self._token)

    async def close_session(self, delete_subs: bool = True) -> None:  # noqa: ARG002 - none outlives its session
        """End the session with all its subscriptions, and log its user out."""
        first, self.over = not self.over, True
        await super().close_session(True)
        if first:
            self.iserver.logging_in.log_out(self._token)
            await self.iserver.ended(self)

    async def write(self, params: ua.WriteParameters) -> list[ua.StatusCode]:
        """Refuse all writes."""
        _check_number(params.NodesToWrite, limits.NODES_AT_ONCE)
        return [
            status(ua.StatusCodes.BadNotWritable if each.NodeId in self.aspace else ua.StatusCodes.BadNodeIdUnknown)
            for each in params.NodesToWrite
        ]

    async def read(self, params: ua.ReadParameters) -> list[ua.DataValue]:
        """Read attributes, within limits."""
        _check_number(params.NodesToRead, limits.NODES_AT_ONCE)
        results = self.iserver.attribute_service.read(params)
        if sum(map(_size, results)) > limits.ANSWER:
            raise ServiceError(ua.StatusCodes.BadResponseTooLarge)
        return results

    async def browse(self, params: ua.BrowseParameters) -> list[ua.BrowseResult]:
        """Return references of nodes, within limits."""
        _check_number(params.NodesToBrowse, limits.NODES_AT_ONCE)
        results, left = [], limits.REFERENCES_AT_ONCE
        for each in params.NodesToBrowse:
            results += self.iserver.view_service.browse(ua.BrowseParameters(NodesToBrowse=[each]))
            left -= len(results[-1].References or ())
            if left < 0:
                raise ServiceError(ua.StatusCodes.BadResponseTooLarge)
        return results

    async def translate_browsepaths_to_nodeids(self, params: list[ua.BrowsePath]) -> list[ua.BrowsePathResult]:
        """Find nodes by browse paths."""
        _check_number(params, limits.NODES_AT_ONCE)
        # asyncua fails for all paths if one is empty.
        found = iter(await super().translate_browsepaths_to_nodeids([each for each in params if _elements(each)]))
        nothing = ua.BrowsePathResult(StatusCode=status(ua.StatusCodes.BadNothingToDo))
        return [next(found) if _elements(each) else nothing for each in params]

    async def history_read(self, params: ua.HistoryReadParameters) -> list[ua.HistoryReadResult]:
        """Return past values."""
        _check_number(params.NodesToRead, limits.HISTORIES_AT_ONCE)
        return await self.iserver.past.read(params)

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Call methods, within limits."""
        _check_number(params, limits.CALLS_AT_ONCE)
        return await super().call(params)

    def own_items(self) -> dict[int, Items]:
        """Return the monitored items of this session by subscription id."""
        return dict(self.subscription_service.listening(self.session_id))

    async def create_subscription(
        self, params: ua.CreateSubscriptionParameters, callback: Any, request_callback: Any = None
    ) -> ua.CreateSubscriptionResult:
        """Create a subscription, within limits."""
        if len(self.own_items()) >= limits.SUBSCRIPTIONS_OF_SESSION:
            raise ServiceError(ua.StatusCodes.BadTooManySubscriptions)
        return await super().create_subscription(params, callback, request_callback)

    async def create_monitored_items(
        self, params: ua.CreateMonitoredItemsParameters
    ) -> list[ua.MonitoredItemCreateResult]:
        """Create monitored items, within limits."""
        self._check_own(params.SubscriptionId)
        wanted, own = params.ItemsToCreate, self.own_items()
        _check_number(wanted, limits.NODES_AT_ONCE)
        first = [self.aspace.read_attribute_value(each.ItemToMonitor.NodeId, ua.AttributeIds.Value) for each in wanted]
        if sum(map(_size, first)) > limits.ANSWER:
            raise ServiceError(ua.StatusCodes.BadResponseTooLarge)
        there = sum(each.count for _, each in self.subscription_service.listening())
        room = min(limits.ITEMS_OF_SESSION - sum(each.count for each in own.values()), limits.ITEMS - there)
        events = limits.EVENT_ITEMS_OF_SESSION - sum(each.event_count for each in own.values())
        return await own[params.SubscriptionId].create(wanted, room, events)

    async def modify_monitored_items(
        self, params: ua.ModifyMonitoredItemsParameters
    ) -> list[ua.MonitoredItemModifyResult]:
        """Modify monitored items."""
        self._check_own(params.SubscriptionId)
        return await super().modify_monitored_items(params)

    async def delete_monitored_items(self, params: ua.DeleteMonitoredItemsParameters) -> list[ua.StatusCode]:
        """Delete monitored items."""
        self._check_own(params.SubscriptionId)
        return await super().delete_monitored_items(params)

    async def set_monitoring_mode(self, params: ua.SetMonitoringModeParameters) -> list[ua.StatusCode]:
        """Enable or disable monitored items."""
        self._check_own(params.SubscriptionId)
        return await super().set_monitoring_mode(params)

    async def set_publishing_mode(self, params: ua.SetPublishingModeParameters) -> list[ua.StatusCode]:
        """Enable or disable subscriptions."""
        params.SubscriptionIds = self._own_only(params.SubscriptionIds)
        return await super().set_publishing_mode(params)

    def modify_subscription(self, params: ua.ModifySubscriptionParameters) -> ua.ModifySubscriptionResult:
        """Return the settings of a subscription; asyncua does not change them."""
        self._check_own(params.SubscriptionId)
        return super().modify_subscription(params)

    def republish(self, params: ua.RepublishParameters) -> ua.NotificationMessage:
        """Send a notification again."""
        self._check_own(params.SubscriptionId)
        return super().republish(params)

    async def delete_subscriptions(self, ids: list[int]) -> list[ua.StatusCode]:
        """Delete subscriptions."""
        return await super().delete_subscriptions(ids if self.over else self._own_only(ids))

    def publish(self, acks: Iterable[ua.SubscriptionAcknowledgement] | None = None) -> tuple[int, list[ua.StatusCode]]:
        """Record acknowledgements, and the request for a further notification."""
        own = self.own_items()
        if not own:
            raise ServiceError(ua.StatusCodes.BadNoSubscription)
        results = []
        for each in acks or []:
            if each.SubscriptionId in own:
                self.subscription_service.subscriptions[each.SubscriptionId].publish([each.SequenceNumber])
            code = ua.StatusCodes.Good if each.SubscriptionId in own else ua.StatusCodes.BadSubscriptionIdInvalid
            results.append(status(code))
        return len(own), results

    async def transfer_subscriptions(self, *_: object) -> list[ua.TransferResult]:
        """Refuse transfers: a subscription ends with its session."""
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)

    def _check_own(self, subscription: int) -> None:
        if subscription not in self.own_items():
            raise ServiceError(ua.StatusCodes.BadSubscriptionIdInvalid)

    def _own_only(self, ids: Sequence[int]) -> list[int]:
        """Return the ids, with an id that does not exist in place of each subscription of another session."""
        _check_number(ids, limits.SUBSCRIPTIONS)
        own = self.own_items()
        return [each if each in own else _NOBODYS for each in ids]


def _elements(path: ua.BrowsePath) -> Sequence[ua.RelativePathElement]:
    return path.RelativePath.Elements or []


def _size(value: ua.DataValue) -> int:
    """Return the approximate bytes of a value in a response."""
    told = value.Value.Value if value.Value is not None else None
    if isinstance(told, list | tuple):
        return _ELEMENT * len(told)
    return len(told) if isinstance(told, str | bytes) else 0


def _check_number(wanted: Sequence[object] | Collection[object] | None, most: int) -> None:
    if not wanted:
        raise ServiceError(ua.StatusCodes.BadNothingToDo)
    if len(wanted) > most:
        raise ServiceError(ua.StatusCodes.BadTooManyOperations)
