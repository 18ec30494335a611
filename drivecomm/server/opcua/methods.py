"""Commands as methods: which methods exist, which of them a drive has, and the results of calls.

One method node serves all drives. A call returns Good only if the command was carried out and confirmed; otherwise the
outcome and a text explain the result. Stops need neither a lock nor permission in the plant file.
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

from asyncua import ua

from drivecomm.errors import DriveCommError, LeaseError, NotAllowedError, ReadOnlyError, UsageError, in_one_line
from drivecomm.server import CommandRequest
from drivecomm.server.opcua.active_request import current_request
from drivecomm.server.opcua.limits import VALID_S
from drivecomm.server.opcua.method_table import LOCKING, METHODS, STOP_ALL, STOPS
from drivecomm.server.opcua.nodes import COMPONENT, GENERATES, standard
from drivecomm.server.opcua.states import DRIVE, LINE, declare_states
from drivecomm.server.opcua.value_facts import monitoring_only
from drivecomm.server.opcua.values import GOOD, status

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import DriveConfig
    from drivecomm.server import CommandAnswer, ServedPlant
    from drivecomm.server.opcua.drive_nodes import DriveNodes
    from drivecomm.server.opcua.locks import Locks
    from drivecomm.server.opcua.method_table import Method
    from drivecomm.server.opcua.nodes import Nodes

_BAD_ARGUMENT, _OUT_OF_RANGE = ua.StatusCodes.BadTypeMismatch, ua.StatusCodes.BadOutOfRange
_LONGEST_TEXT = 200
_NUMBERS = frozenset(
    ua.VariantType[name] for name in ("SByte", "Byte", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
)
_DECIMALS = _NUMBERS | {ua.VariantType.Float, ua.VariantType.Double}
_FITS: Mapping[ua.VariantType, frozenset[ua.VariantType]] = {
    ua.VariantType.Double: _DECIMALS,
    ua.VariantType.UInt16: _NUMBERS,
}


class Types:
    """Types of drives, lines and events."""

    def __init__(self, nodes: Nodes) -> None:
        self.drive = nodes.object_type(
            standard(ua.ObjectIds.BaseObjectType),
            nodes.id("types", "DriveType"),
            "DriveType",
            "A variable-frequency drive of the plant.",
        )
        self.line = nodes.object_type(
            standard(ua.ObjectIds.BaseObjectType), nodes.id("types", "LineType"), "LineType", "A line of the plant."
        )
        declare_states(nodes, self.drive, DRIVE)
        declare_states(nodes, self.line, LINE)
        self.event = nodes.object_type(
            standard(ua.ObjectIds.SystemEventType),
            nodes.id("types", "PlantEventType"),
            "PlantEventType",
            "An event of the plant.",
        )
        for name in ("Kind", "Drive", "Line", "Who"):
            below = nodes.id("types", "PlantEventType", name)
            nodes.variable(
                self.event, below, name, ua.DataValue(ua.Variant("", ua.VariantType.String)), ua.ObjectIds.String
            )
        nodes.refer(self.drive, self.event, GENERATES)


class Methods:
    """Methods of a plant's drives. drive_at: returns the drive of a node, None for another node."""

    def __init__(
        self, plant: ServedPlant, nodes: Nodes, locks: Locks, drive_at: Callable[[ua.NodeId], str | None]
    ) -> None:
        self._plant, self._nodes, self._locks, self._drive_at = plant, nodes, locks, drive_at

    def made(self) -> Types:
        """Create types and methods; return the types."""
        types = Types(self._nodes)
        for method in METHODS:
            self._make(types.drive, method)
        for method in (STOP_ALL, *LOCKING):
            self._make(types.drive, method)
        self._nodes.refer_no_more(types.drive, {self._id(method) for method in (STOP_ALL, *LOCKING)})
        return types

    def give_plant(self, root: ua.NodeId) -> None:
        """Add the method that stops all drives to the plant."""
        self._nodes.refer(root, self._id(STOP_ALL), COMPONENT)

    def give_drive(self, drive: DriveNodes, config: DriveConfig) -> None:
        """Add the lock, the stop methods and the permitted methods to a drive."""
        allowed = (*config.network.verbs.get("opcua", ()), *(("write",) if config.network.write else ()))
        if monitoring_only(config):
            allowed = tuple(word for word in allowed if word == "write")
        has = [self._id(each) for each in METHODS if each in STOPS or (config.armed and each.word in allowed)]
        self._nodes.refer_no_more(drive.node, {self._id(each) for each in METHODS}.difference(has))
        for node in has:
            self._nodes.refer(drive.node, node, COMPONENT)
        for method in LOCKING:
            self._nodes.refer(drive.lock, self._id(method), COMPONENT)

    def stops(self, method: ua.NodeId) -> bool:
        """Whether a node is a stop method."""
        return method in {self._id(each) for each in (*STOPS, STOP_ALL)}

    def _id(self, method: Method) -> ua.NodeId:
        return self._nodes.id("methods", method.name)

    def _make(self, parent: ua.NodeId, method: Method) -> None:
        async def call(node: ua.NodeId, *given: ua.Variant) -> ua.CallMethodResult:
            return await self._called(method, node, given)

        takes = [each.described for each in method.takes]
        gives = [each.described for each in method.gives]
        self._nodes.method(parent, self._id(method), method.name, call, takes, gives, method.about)

    async def _called(self, method: Method, node: ua.NodeId, given: tuple[ua.Variant, ...]) -> ua.CallMethodResult:
        if (wrong := _misfits(method, given)) is not None:
            return wrong
        values = [each.Value for each in given]
        if method is STOP_ALL:
            return await self._stop_all()
        if method in LOCKING:
            drive = self._drive_at(self._nodes.id(str(node.Identifier).removesuffix("/Lock")))
            if drive is None or not str(node.Identifier).endswith("/Lock"):
                return _bad(ua.StatusCodes.BadMethodInvalid)
            return await self._lock(method, drive)
        drive = self._drive_at(node)
        if drive is None:
            return _bad(ua.StatusCodes.BadMethodInvalid)
        return await self._command(method, drive, values)

    async def _command(self, method: Method, drive: str, values: list[Any]) -> ua.CallMethodResult:
        now = current_request.get()
        left_s = VALID_S - now.waited_s
        if left_s <= 0 and method not in STOPS:
            text = f"the call arrived after {now.waited_s:.1f} s, but is valid for only {VALID_S:g} s; nothing was sent"
            self._plant.refuse(now.session.caller, CommandRequest(drive=drive, verb=method.verb), text)
            return _answer("refused", text, ua.StatusCodes.BadTimeout)
        try:
            arguments = method.arguments(values)
        except UsageError as error:
            return _answer("refused", in_one_line(error), ua.StatusCodes.BadInvalidArgument)
        command = CommandRequest(
            drive=drive,
            verb=method.verb,
            arguments=arguments,
            lease=self._locks.key(now.session, drive),
            valid_s=max(left_s, 0.01),
        )
        return _told(await self._plant.command(now.session.caller, command))

    async def _stop_all(self) -> ua.CallMethodResult:
        try:
            stopped = await self._plant.stop_all(current_request.get().session.caller, "ramp")
        except DriveCommError as error:
            return _answer("refused", in_one_line(error), _code(error))
        # Broadcasts are never confirmed.
        one_by_one = [each for each in stopped if not each.drive.endswith(":*")]
        if not one_by_one:
            return _answer("refused", "there is no drive that could be stopped", ua.StatusCodes.BadInvalidState)
        left = [each.drive for each in one_by_one if each.answer.outcome != "done"]
        if not left:
            return _answer("done", f"{len(one_by_one)} drives have confirmed", ua.StatusCodes.Good)
        refused = all(each.answer.outcome == "refused" for each in one_by_one)
        first = next(each.answer for each in one_by_one if each.answer.outcome != "done")
        why = "" if first.error is None else f": {in_one_line(first.error)}"
        text = f"{len(left)} of {len(one_by_one)} drives have not confirmed, {left[0]} first{why}"
        code = ua.StatusCodes.BadUserAccessDenied if refused else ua.StatusCodes.BadTimeout
        return _answer("refused" if refused else "open", text, code)

    async def _lock(self, method: Method, drive: str) -> ua.CallMethodResult:
        act = {
            "InitLock": self._locks.init,
            "RenewLock": self._locks.renew,
            "ExitLock": self._locks.end,
            "BreakLock": self._locks.break_,
        }[method.name]
        number, text = await act(current_request.get(), drive)
        return ua.CallMethodResult(
            StatusCode=GOOD,
            OutputArguments=[ua.Variant(number, ua.VariantType.Int32), ua.Variant(text, ua.VariantType.String)],
        )


def _told(answer: CommandAnswer) -> ua.CallMethodResult:
    text = "" if answer.error is None else in_one_line(answer.error)
    if answer.outcome == "done":
        return _answer("done", text, ua.StatusCodes.Good)
    code = {
        "refused": _code(answer.error),
        "failed": ua.StatusCodes.BadDeviceFailure,
        "open": ua.StatusCodes.BadTimeout,
    }[answer.outcome]
    return _answer(answer.outcome, text or "whether the drive has acted is not known", code)


def _code(error: DriveCommError | None) -> int:
    if isinstance(error, NotAllowedError | ReadOnlyError):
        return ua.StatusCodes.BadUserAccessDenied
    if isinstance(error, LeaseError):
        return ua.StatusCodes.BadRequiresLock
    return ua.StatusCodes.BadInvalidArgument if isinstance(error, UsageError) else ua.StatusCodes.BadInvalidState


def _answer(outcome: str, text: str, code: int) -> ua.CallMethodResult:
    return ua.CallMethodResult(
        StatusCode=status(code),
        OutputArguments=[ua.Variant(outcome, ua.VariantType.String), ua.Variant(text, ua.VariantType.String)],
    )


def _bad(code: int) -> ua.CallMethodResult:
    return ua.CallMethodResult(StatusCode=status(code))


def _misfits(method: Method, given: tuple[ua.Variant, ...]) -> ua.CallMethodResult | None:
    """Return the result of a call with wrong arguments, None if the arguments fit the method."""
    if len(given) != len(method.takes):
        few = len(given) < len(method.takes)
        return _bad(ua.StatusCodes.BadArgumentsMissing if few else ua.StatusCodes.BadTooManyArguments)
    codes = [_code_of_argument(each.kind, value) for each, value in zip(method.takes, given, strict=True)]
    if not any(codes):
        return None
    result = _bad(ua.StatusCodes.BadInvalidArgument)
    result.InputArgumentResults = [status(code) for code in codes]
    return result


def _code_of_argument(kind: ua.VariantType, given: ua.Variant) -> int:
    if given.is_array or given.Value is None or given.VariantType not in _FITS.get(kind, (kind,)):
        return _BAD_ARGUMENT
    if kind is ua.VariantType.Double and not isfinite(given.Value):
        return _OUT_OF_RANGE
    if kind is ua.VariantType.UInt16 and not 0 <= given.Value < 2**16:
        return _OUT_OF_RANGE
    if kind is ua.VariantType.String and len(given.Value) > _LONGEST_TEXT:
        return _OUT_OF_RANGE
    return 0
