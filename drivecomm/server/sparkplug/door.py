"""The Sparkplug door that a `[[door]]` of a plant file configures."""

from __future__ import annotations

import asyncio
import hashlib
import random
import socket
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.errors import LinkError, UsageError, in_one_line
from drivecomm.line import STATUS
from drivecomm.link import Backoff
from drivecomm.server import (
    ANONYMOUS,
    LEVELS_KEY,
    LINE,
    PLANT,
    SITES,
    Caller,
    DoorHealth,
    Role,
    run_concurrently,
    state_folder,
)
from drivecomm.server.broker import BROKER_KEYS, broker_settings
from drivecomm.server.sparkplug.topics import SparkplugTopics, id_of, is_id
from drivecomm.tomlfile import LIST, TEXT, Kind

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import DriveConfig
    from drivecomm.server import CommandAnswer, CommandRequest, DriveSnapshot, ServedPlant
    from drivecomm.server.broker import BrokerSettings
    from drivecomm.server.sparkplug.edge_node_state import EdgeNodeState
    from drivecomm.server.sparkplug.hosts import Hosts
    from drivecomm.server.sparkplug.session import SparkplugSession
    from drivecomm.tomlfile import TomlTable

_ROLE = Kind((str,), '"view", so that hosts may stop motors, or "operate"')
_KEYS = {
    "kind": TEXT,
    **BROKER_KEYS,
    "levels": LEVELS_KEY,
    "group": TEXT,
    "node": TEXT,
    "host": TEXT,
    "brokers": LIST,
    "role": _ROLE,
}
_ROLES = {"view": Role.VIEW, "operate": Role.OPERATE}
EVERYBODY = "(broker)"
"""Name of hosts without one; no user can have this name."""

_FIRST_S, _LONGEST_S = 0.5, 4.0
"""Shortest and longest pause between attempts: many gateways reconnect within seconds, but not in the same moment."""
_TAKEN_FIRST_S, _TAKEN_LONGEST_S = 5.0, 30.0
"""Pauses if another edge node has the same name, so that the two do not keep displacing each other."""
_LASTED_S, _PEACE_S, _LOST_SOON = 10.0, 600.0, 3


def sparkplug_door(table: TomlTable) -> SparkplugDoor:
    """Return the Sparkplug door that a table of the plant file describes.

    Raises FileFormatError, or UsageError if a required package is not installed.
    """
    door = SparkplugDoor(table)
    try:
        # Imported here, because the import is slow in the door's thread while lines are busy.
        import aiomqtt  # noqa: F401 - only for plants with such a door

        from drivecomm.server.sparkplug import backlog, hosts, limits, session, wire  # noqa: F401 - as above

        wire.payload_class()
    except ImportError as error:
        raise UsageError(
            f'the Sparkplug door needs more packages ({error}); run pip install "drivecomm[sparkplug]"'
        ) from error
    return door


class SparkplugDoor:
    """Edge node for a plant, on one broker at a time."""

    def __init__(self, table: TomlTable) -> None:
        given = table.take(_KEYS)
        self._levels: Mapping[str, str] = given.pop("levels", {})
        sites = [name for each, name in self._levels.items() if each in SITES]
        # Names of levels may have any characters and are converted; names in the door itself must be valid.
        by_levels = {"group": id_of(":".join(sites)), "node": id_of(self._levels.get(PLANT, ""))}
        given = {**{key: each for key, each in by_levels.items() if each}, **given}
        for key, levels in (("group", "a site or an area"), ("node", PLANT)):
            if key not in given:
                raise table.error(f"the key {key!r} is missing; write {key} = {TEXT.words}, or {levels} among levels")
        for key in ("group", "node", "host"):
            if key in given and not is_id(given[key]):
                raise table.error(f"invalid {key} = {given[key]!r}; write a text without / + and #", key)
        urls = given.pop("brokers", None)
        if urls is not None and "broker" in given:
            raise table.error("broker and brokers exclude each other; leave one of them out", "broker")
        if urls is not None and not (urls and all(isinstance(url, str) for url in urls)):
            raise table.error(
                'brokers is a list of one or more; write brokers = ["mqtt://one", "mqtt://two"]', "brokers"
            )
        said = [given] if urls is None else [{**given, "broker": url} for url in urls]
        self._brokers = [broker_settings(table, each) for each in said]
        self._topics = SparkplugTopics(group=given["group"], node=given["node"], host=given.get("host", ""))
        role = given.get("role")
        if role is not None and role not in _ROLES:
            raise table.error(f"invalid role = {role!r:.80}; write {_ROLE.words}", "role")
        # The broker does not reveal the sender of a command, so it must restrict who may send one.
        self._caller = Caller(
            name=ANONYMOUS if role is None else self._topics.host or EVERYBODY,
            role=Role.NOBODY if role is None else _ROLES[role],
            door=self.name,
        )
        self._session: SparkplugSession | None = None
        self._kept: EdgeNodeState | None = None
        self._told = ""

    @property
    def name(self) -> str:
        """Name of the door in callers and events."""
        return f"sparkplug {self._topics.group}/{self._topics.node}"

    def health(self) -> DoorHealth:
        """Return whether the edge node is born, and the row up to which the history has certainly been delivered."""
        return DoorHealth(
            up=self._session is not None and self._session.born,
            delivered_row=None if self._kept is None else self._kept.row,
        )

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled. Raises UsageError if two drives would have the same device name."""
        from drivecomm.server.sparkplug.backlog import Backlog
        from drivecomm.server.sparkplug.commanding import command_metrics, verbs_allowed
        from drivecomm.server.sparkplug.edge_node import EdgeNode
        from drivecomm.server.sparkplug.edge_node_state import EdgeNodeState
        from drivecomm.server.sparkplug.hosts import Hosts
        from drivecomm.server.sparkplug.limits import limits_of
        from drivecomm.server.sparkplug.topics import device_ids

        device_ids({drive.name: self._device_name(drive) for drive in plant.drives()})
        kept = await asyncio.to_thread(EdgeNodeState, self._file(plant))
        keep_alive_s = max(each.keep_alive_s for each in self._brokers)
        backlog = None if plant.history is None else Backlog(plant.history, kept, keep_alive_s)
        if backlog is not None:
            await backlog.begin()
            self._kept = kept
        # Reads the model files here, so that the event loop does not block later while hosts wait.
        await asyncio.to_thread(lambda: [limits_of(drive, "", "") for drive in plant.plant.drives])
        node = EdgeNode(
            plant,
            lambda drive: command_metrics(verbs_allowed(plant.may(self._caller, drive))),
            limits_of,
            self._device_name,
        )
        hosts = Hosts(plant, self._caller, self._topics, self._answered)

        def session(bd_seq: int) -> SparkplugSession:
            from drivecomm.server.sparkplug.session import SparkplugSession

            only = len(self._brokers) == 1
            return SparkplugSession(plant, node, hosts, backlog, self._topics, bd_seq=bd_seq, is_only=only)

        await self._stay_connected(plant, session, hosts, kept, opened)

    async def _stay_connected(
        self,
        plant: ServedPlant,
        session: Callable[[int], SparkplugSession],
        hosts: Hosts,
        kept: EdgeNodeState,
        opened: Callable[[], None],
    ) -> None:
        """Connect to one broker after the other, changing whenever a connection ends."""
        from drivecomm.server.broker import IdentityTakenOver
        from drivecomm.server.sparkplug.session import HostGoneError

        now = asyncio.get_running_loop().time
        soon, taken, turn = Backoff(_FIRST_S, _LONGEST_S), Backoff(_TAKEN_FIRST_S, _TAKEN_LONGEST_S), 0
        another, lost_soon = f"check for another edge node {self.name.partition(' ')[2]}", 0
        while True:
            settings, began, pauses = self._brokers[turn % len(self._brokers)], now(), soon
            new = self._session = session(await asyncio.to_thread(kept.next_connection))
            try:
                await run_concurrently(self._connect(plant, settings, new, opened))
            except HostGoneError as error:
                problem = f"broker {settings.place}: {error}"
            except IdentityTakenOver as error:
                problem, pauses = f"{error}; {another}", taken
            except UsageError as error:
                problem, pauses = in_one_line(error), taken
            except (LinkError, TimeoutError) as error:
                problem = in_one_line(error)
                if _nobody_was_there(error):
                    kept.not_connected()
                lost_soon = lost_soon + 1 if new.born and now() - began < _LASTED_S else 0
                if lost_soon >= _LOST_SOON:
                    # Not every broker reports that another client has taken over the client id.
                    problem, pauses = f"broker {settings.place}: is repeatedly lost immediately; {another}", taken
            finally:
                self._session = None
                hosts.forget()
            turn += 1
            self._tell(plant, f"{problem}; {'the next broker' if len(self._brokers) > 1 else 'it'} is tried")
            opened()
            if now() - began >= (_PEACE_S if pauses is taken else _LASTED_S):
                pauses.succeeded()
            pauses.failed(now())
            await asyncio.sleep((pauses.over_at - now()) * random.uniform(0.5, 1.0))  # noqa: S311 - spreads them only

    async def _connect(
        self, plant: ServedPlant, settings: BrokerSettings, new: SparkplugSession, opened: Callable[[], None]
    ) -> None:
        from drivecomm.server.broker import client_id_of, connect_to_broker

        # Derived from the edge node, so that a broker rejects two with the same name.
        client_id = settings.client_id or client_id_of(f"drivecomm-{self._topics.group}-{self._topics.node}")
        async with connect_to_broker(settings, client_id, new.heard, new.will()) as connection:
            try:
                await new.run(connection, partial(self._opened, plant, settings, opened))
            except (asyncio.CancelledError, LinkError):
                await new.farewell(connection)
                raise

    def _opened(self, plant: ServedPlant, settings: BrokerSettings, opened: Callable[[], None]) -> None:
        if self._told:
            self._told = ""
            plant.tell(f"broker {settings.place} is connected again", who=self.name)
        opened()

    def _tell(self, plant: ServedPlant, problem: str) -> None:
        """Report a problem once, until it changes."""
        if problem != self._told:
            self._told = problem
            plant.tell(problem, who=self.name)

    def _answered(self, command: CommandRequest, answer: CommandAnswer, text: str) -> None:
        if self._session is not None:
            self._session.answered(command, answer, text)

    def address_of(self, _plant: str, drive: DriveConfig, name: str) -> str:
        """Return group, edge node, device and metric of a value."""
        from drivecomm.server.sparkplug.metrics import VALUES

        metric = "Status/State" if name == STATUS else VALUES + name
        return f"{self._topics.group}/{self._topics.node}/{id_of(self._device_name(drive))}/{metric}"

    def _device_name(self, drive: DriveSnapshot | DriveConfig) -> str:
        return f"{drive.line}:{drive.name}" if LINE in self._levels else drive.name

    def _file(self, plant: ServedPlant) -> Path:
        named = hashlib.sha256(f"{self._topics.group}/{self._topics.node}".encode()).hexdigest()[:8]
        return state_folder(Path(plant.plant.file)) / f"sparkplug-{named}.json"


def _nobody_was_there(error: BaseException | None) -> bool:
    """Whether no connection was made at all, so that no broker has our will."""
    while error is not None:
        if isinstance(error, ConnectionRefusedError | socket.gaierror):
            return True
        # aiomqtt raises its own error without an explicit cause.
        error = error.__cause__ or error.__context__
    return False
