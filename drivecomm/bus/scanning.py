"""Scan of a line: the addresses to probe, their order, and the results of the probes.

A plain scan probes each protocol's addresses at the settings that its drives have by default. A wide scan tries other
line settings, too: the likely ones of all protocols before the unlikely ones of any.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.bus.likely_settings import likely_settings
from drivecomm.bus.series_proof import fitting
from drivecomm.errors import DriveCommError, NoReplyError, OvertakenError, ReplyError, UsageError, shortened
from drivecomm.line import Job, Rank
from drivecomm.models import load_model, model_names
from drivecomm.protocol import Ask, DriveConfig, installed, parse_options

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.bus.line_drives import DriveParts
    from drivecomm.link import Peer
    from drivecomm.protocol import Exchange, LineSettings, Model, Operations, Protocol

FIRST_ADDRESSES = 3
"""Number of addresses of each protocol that are probed first.

Drives are counted from 1, and a single drive keeps its number.
"""

# The other addresses are probed together with the first ones' fourth most likely settings.
_FURTHER_ADDRESS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A drive that a scan found: its place on the line, and its identity.

    sound: False if only damaged replies came. settings: the line settings at which it answered. options: the drive
    options with which it was probed, if these are not the usual ones. model: the one model of its protocol that matches
    its identity; empty if none or several do. candidates: the models that it may be of: those that match its identity
    and, if commands depend on the model, all those that nothing in its registers contradicts.
    """

    protocol: str
    address: int
    identity: Mapping[str, str] = field(default_factory=dict)
    sound: bool
    detail: str = ""
    settings: LineSettings | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    model: str = ""
    candidates: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The drive as the command line names it."""
        return f"{self.protocol}:{self.address}"

    @property
    def drive(self) -> DriveConfig:
        """The drive with its model and its line settings, for `found.drive.build(bus.drive)`."""
        line = {} if self.settings is None else options_of(self.settings)
        options = {**({"model": self.model} if self.model else {}), **self.options, **line}
        return DriveConfig(protocol=self.protocol, address=self.address, options=options)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanProbe:
    """One probe of a scan, at one address and with one choice of line settings.

    settings: None for those that the bus has for the protocol. variant: drive options other than the usual ones.
    """

    protocol: str
    address: int
    settings: LineSettings | None = None
    variant: Mapping[str, Any] = field(default_factory=dict, hash=False)

    @property
    def options(self) -> dict[str, Any]:
        """Drive options and line facts for the communication with a drive at this place."""
        return {**self.variant, **({} if self.settings is None else options_of(self.settings))}

    def __str__(self) -> str:
        asked = ",".join([self.protocol, *(f"{name}={value}" for name, value in self.variant.items())])
        return asked if self.settings is None else f"{asked} {self.settings}"


@dataclass(slots=True, eq=False)
class ScanRequest:
    """A request of a scan. found: its result, which the caller that carries it out fills in.

    It waits behind all other calls, and is repeated if a stop goes first.
    """

    peer: Peer
    exchange: Callable[[], Exchange[Found | None]]
    found: Found | None = None

    @property
    def job(self) -> Job[Found | None]:
        """The job for this request; a new one at each access."""
        return Job(self.peer, self.exchange(), Rank.SURVEY, insists=True)


class Search:
    """The probes of a scan, one after the other. It does no I/O; the caller reports the results with `heard`.

    only: protocol names, also with drive options, as in `toy,end=1`; all installed protocols if absent. addresses: the
    addresses to probe, the protocol's usual ones if absent; addresses that a protocol does not have are left out.
    choices: line settings that a wide scan tries; None for a plain scan.
    """

    def __init__(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        choices: LineChoices | None = None,
    ) -> None:
        plain = _asked(only, addresses)
        self._models: dict[str, Sequence[Model]] = {}
        self._left = deque(
            [ScanProbe(protocol=plugin.name, address=address, variant=variant) for plugin, variant, address in plain]
            if choices is None
            else self._widely(plain, choices)
        )
        self._for_all = only is None
        self._damaged: dict[tuple[str, int], Found] = {}
        self._wide = choices is not None
        self._under_way = 0
        self.done = 0

    def __iter__(self) -> Iterator[ScanProbe]:
        """Yield the next probe; earlier results change which probes follow, and their order."""
        while self._left:
            asking, self._under_way = self._left.popleft(), 1
            yield asking
            self.done, self._under_way = self.done + 1, 0

    @property
    def total(self) -> int:
        """Number of probes at present; it becomes smaller when a drive answers."""
        return self.done + self._under_way + len(self._left)

    @property
    def left(self) -> Sequence[ScanProbe]:
        """The remaining probes, in order."""
        return tuple(self._left)

    def leave_out(self, foreign: Callable[[Protocol], bool]) -> None:
        """Remove the probes of protocols that this line cannot carry, unless they were requested by name."""
        if self._for_all:
            self._left = deque(each for each in self._left if not foreign(installed[each.protocol]))

    def heard(self, asking: ScanProbe, found: Found | None) -> Found | None:
        """Process the result of a probe; return the drive if it was unknown.

        Damage shows that a drive is there with other settings. A wide scan then probes this address at all its settings
        next, and reports the damage only at the end, if nothing better came.
        """
        if found is None:
            return None
        if self._wide and not found.sound:
            self._damaged.setdefault((asking.protocol, asking.address), found)
            self._first(lambda each: each.protocol == asking.protocol and each.address == asking.address)
            return None
        self._damaged.pop((asking.protocol, asking.address), None)
        self._left = deque(
            each
            for each in self._left
            if (each.protocol, each.address) != (asking.protocol, asking.address)
            # A reply that is damaged for one variant may be sound for another.
            or (not found.sound and each.variant != asking.variant)
        )
        if self._wide:
            # A line usually has one speed for all its drives, and drives of one maker were set up together.
            self._first(lambda each: each.settings == asking.settings)
            self._first(lambda each: each.settings == asking.settings and each.protocol == asking.protocol)
        return found

    def damaged(self) -> list[Found]:
        """Return the drives from which only damaged replies came."""
        return list(self._damaged.values())

    def model_of(self, found: Found) -> Found:
        """Return the drive with its model, if its identity fits exactly one; reads the models of its protocol."""
        if not found.identity:
            return found
        matching = [model.name for model in self._models_of(installed[found.protocol]) if model.matches(found.identity)]
        candidates = tuple(dict.fromkeys([*matching, *found.candidates]))
        return replace(found, model=matching[0] if len(matching) == 1 else "", candidates=candidates)

    def fitting(self, found: Found) -> Exchange[Found]:
        """Add the models that fit a drive by its registers, if commands of its protocol depend on the model."""
        plugin = installed[found.protocol]
        candidates = yield from fitting(plugin, found.address, self._models_of(plugin))
        return replace(found, candidates=candidates)

    def _first(self, wanted: Callable[[ScanProbe], bool]) -> None:
        # A stable sort keeps the likely settings first, both among the wanted probes and among the others.
        self._left = deque(sorted(self._left, key=lambda each: not wanted(each)))

    def _models_of(self, plugin: Protocol) -> Sequence[Model]:
        if plugin.name not in self._models:
            self._models[plugin.name] = _readable_models(plugin)
        return self._models[plugin.name]

    def _widely(
        self, plain: Sequence[tuple[Protocol, Mapping[str, Any], int]], choices: LineChoices
    ) -> list[ScanProbe]:
        addresses: dict[tuple[str, str], list[int]] = {}
        variants: dict[tuple[str, str], Mapping[str, Any]] = {}
        for plugin, variant, address in plain:
            key = plugin.name, repr(variant)
            variants[key] = variant
            addresses.setdefault(key, []).append(address)
        ranked = []
        for number, (key, some) in enumerate(addresses.items()):
            name, plugin = key[0], installed[key[0]]
            likely = likely_settings(
                plugin, self._models_of(plugin), choices, eight_bits=_needs_eight_bits(plugin, some[0])
            )
            for place, each in enumerate(likely):
                for counted, address in enumerate(some):
                    later = 0 if counted < FIRST_ADDRESSES else _FURTHER_ADDRESS
                    order = (each.unlikeliness + later, number, place, counted)
                    ranked.append(
                        (
                            order,
                            ScanProbe(protocol=name, address=address, settings=each.settings, variant=variants[key]),
                        )
                    )
        return [asking for _, asking in sorted(ranked, key=lambda one: one[0])]


def options_of(settings: LineSettings) -> dict[str, Any]:
    """Return line settings as options for `Bus.drive` and `open_bus`."""
    return asdict(settings)


def scan_plan(only: Iterable[str] | None, addresses: Iterable[int] | None) -> list[tuple[Protocol, int]]:
    """Return what a scan probes, in order: protocols and addresses, without addresses that a protocol does not have."""
    return [(plugin, address) for plugin, _, address in _asked(only, addresses)]


def _asked(
    only: Iterable[str] | None, addresses: Iterable[int] | None
) -> list[tuple[Protocol, Mapping[str, Any], int]]:
    """Return what a scan probes: protocols, drive options given with a protocol's name, and addresses."""
    if only is not None and (isinstance(only, str) or not isinstance(only, Iterable)):
        raise UsageError(f"invalid protocols = {shortened(only)}; give a list, such as ['vabus']")
    plugins: list[tuple[Protocol, Mapping[str, Any]]]
    plugins = [_variant(each) for each in only] if only is not None else [(each, {}) for each in installed.working()]
    try:
        wanted = None if addresses is None else list(addresses)
    except TypeError:
        raise UsageError(f"invalid addresses = {shortened(addresses)}; give a list of numbers") from None
    return [
        (plugin, variant, address)
        for plugin, variant in plugins
        for address in (wanted if wanted is not None else plugin.scan_addresses)
        if address in plugin.addresses
    ]


def _variant(text: str) -> tuple[Protocol, Mapping[str, Any]]:
    """Return the protocol and the drive options of a scan argument: `toy` or `toy,end=1`. Raises UsageError."""
    name, *options = text.split(",") if isinstance(text, str) else (text,)
    return installed[name], parse_options(options)


def scanning(
    search: Search, member_of: Callable[[ScanProbe], DriveParts], progress: Callable[[str, int, int], None] | None
) -> Iterator[ScanRequest | Found]:
    """Yield the requests of a scan, whose results the caller must fill in, and the drives that they find."""
    asking = None
    for asking in search:
        if progress is not None:
            progress(str(asking), search.done, search.total)
        peer, operations, _ = member_of(asking)
        question = ScanRequest(peer, partial(probe, asking, operations, peer.facts.settings))
        yield question
        found = search.heard(asking, question.found)
        if found is not None and found.sound:
            question = ScanRequest(peer, partial(identify, found, operations))
            yield question
            found = question.found or found
            question = ScanRequest(peer, partial(search.fitting, found))
            yield question
            found = question.found
        if found is not None:
            yield found
    yield from search.damaged()
    if progress is not None and asking is not None:
        progress(str(asking), search.total, search.total)


def probe(asking: ScanProbe, operations: Operations, settings: LineSettings) -> Exchange[Found | None]:
    """Probe one address; return None if no drive answers. settings: settings of the line."""
    try:
        yield from operations.probe()
    except OvertakenError:
        raise
    except NoReplyError:
        return None
    except ReplyError as error:
        return Found(
            protocol=asking.protocol,
            address=asking.address,
            sound=False,
            detail=str(error),
            settings=settings,
            options=asking.variant,
        )
    return Found(
        protocol=asking.protocol, address=asking.address, sound=True, settings=settings, options=asking.variant
    )


def identify(found: Found, operations: Operations) -> Exchange[Found]:
    """Read the identity of a drive that has answered."""
    try:
        identity = yield from operations.identify()
    except OvertakenError:
        raise
    except ReplyError as error:
        return replace(found, detail=str(error))
    return replace(found, identity=identity)


def _readable_models(plugin: Protocol) -> Sequence[Model]:
    found = []
    for name in model_names(plugin.package, plugin.name):
        try:
            found.append(load_model(plugin.package, plugin.name, name))
        except DriveCommError:
            # An invalid model file of the user must not prevent drives from being found.
            continue
    return tuple(found)


def _needs_eight_bits(plugin: Protocol, address: int) -> bool:
    """Return whether even the probe of a protocol has a byte that seven data bits cannot carry."""
    options = plugin.options()
    exchange = plugin.operations(address, options, None).probe()
    command = next(exchange)
    while not isinstance(command, Ask):
        command = exchange.send(None)
    exchange.close()
    return max(plugin.codec(options).encode(command.message)) > 0x7F
