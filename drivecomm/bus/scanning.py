"""Who is on a line: whom a scan asks in which order, and what is made of the answers.

A plain scan asks each protocol's addresses at the settings that its drives have unless somebody changed them. A wide
one tries other line settings, too: the likely ones of all protocols before the unlikely ones of any.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.bus.likely_settings import likely_settings
from drivecomm.bus.right_drive import fitting
from drivecomm.errors import DriveCommError, NoReplyError, OvertakenError, ReplyError, UsageError, shortened
from drivecomm.line import Job, Rank
from drivecomm.models import load_model, model_names
from drivecomm.protocol import Ask, DriveConfig, installed, parse_options

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.bus.roster import Member
    from drivecomm.link import Peer
    from drivecomm.protocol import Exchange, LineSettings, Model, Operations, Protocol

FIRST_ADDRESSES = 3
"""So many addresses of each protocol are asked first: drives are counted from 1, and a single one keeps its number."""

# The other addresses come with the first ones' fourth most likely settings.
_FURTHER_ADDRESS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A drive that a scan met: where, and what it tells of itself.

    sound: False if it answered with damage only. settings: the line settings at which it answered. options: the drive
    options by which it was asked, where these are not the usual ones. model: the one model of its protocol that knows
    itself in what the drive tells, empty where none or several do. candidates: the models that it may be of: those that
    know themselves, and, where commands are the model's own, all those that nothing in its registers speaks against.
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
        """The drive with the model and the line settings by which it is spoken to: `found.drive.build(bus.drive)`."""
        line = {} if self.settings is None else options_of(self.settings)
        options = {**({"model": self.model} if self.model else {}), **self.options, **line}
        return DriveConfig(protocol=self.protocol, address=self.address, options=options)


@dataclass(frozen=True, slots=True, kw_only=True)
class Asking:
    """One step of a scan: to ask whether somebody is at this address, at these line settings.

    settings: None for those that the bus has for the protocol. variant: drive options other than the usual ones.
    """

    protocol: str
    address: int
    settings: LineSettings | None = None
    variant: Mapping[str, Any] = field(default_factory=dict, hash=False)

    @property
    def options(self) -> dict[str, Any]:
        """Drive options and line facts for speaking with whoever is there."""
        return {**self.variant, **({} if self.settings is None else options_of(self.settings))}

    def __str__(self) -> str:
        asked = ",".join([self.protocol, *(f"{name}={value}" for name, value in self.variant.items())])
        return asked if self.settings is None else f"{asked} {self.settings}"


@dataclass(slots=True, eq=False)
class Question:
    """A question of a scan. found: what it resulted in, for whoever carries it out to fill in.

    It waits behind all others, and is asked again if a stop goes first.
    """

    peer: Peer
    exchange: Callable[[], Exchange[Found | None]]
    found: Found | None = None

    @property
    def job(self) -> Job[Found | None]:
        """The job that asks; a new one each time."""
        return Job(self.peer, self.exchange(), Rank.SURVEY, insists=True)


class Search:
    """The questions of a scan, one after the other. It does no I/O; whoever asks them says what was heard.

    only: protocol names, also with drive options, as in `toy,end=1`; all installed ones if absent. addresses: those to
    ask, the protocol's usual ones if absent; addresses that a protocol does not have are left out. choices: which line
    settings a wide scan tries; None for a plain one.
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
            [Asking(protocol=plugin.name, address=address, variant=variant) for plugin, variant, address in plain]
            if choices is None
            else self._widely(plain, choices)
        )
        self._for_all = only is None
        self._damaged: dict[tuple[str, int], Found] = {}
        self._wide = choices is not None
        self._under_way = 0
        self.done = 0

    def __iter__(self) -> Iterator[Asking]:
        """Yield what to ask next; what was heard meanwhile changes what is asked, and when."""
        while self._left:
            asking, self._under_way = self._left.popleft(), 1
            yield asking
            self.done, self._under_way = self.done + 1, 0

    @property
    def total(self) -> int:
        """How many questions there are as things stand; fewer once somebody has answered."""
        return self.done + self._under_way + len(self._left)

    @property
    def left(self) -> Sequence[Asking]:
        """The questions that have not been asked, in their order."""
        return tuple(self._left)

    def leave_out(self, foreign: Callable[[Protocol], bool]) -> None:
        """Ask nothing in the protocols that cannot be spoken on this line, unless they were asked for by name."""
        if self._for_all:
            self._left = deque(each for each in self._left if not foreign(installed[each.protocol]))

    def heard(self, asking: Asking, found: Found | None) -> Found | None:
        """Take in what came of a question, and return the drive if it is one that nobody knew.

        Damage says that somebody is there and speaks otherwise: a wide scan asks this address at all its settings then,
        and tells of the damage at the end only, if nothing better came.
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
            # What is damage by one variant may be sound by another.
            or (not found.sound and each.variant != asking.variant)
        )
        if self._wide:
            # A line has one speed as a rule, whoever is on it; and those of one maker were set up together.
            self._first(lambda each: each.settings == asking.settings)
            self._first(lambda each: each.settings == asking.settings and each.protocol == asking.protocol)
        return found

    def damaged(self) -> list[Found]:
        """Return those of whom nothing but damage came."""
        return list(self._damaged.values())

    def model_of(self, found: Found) -> Found:
        """Return the drive with its model, where what it tells fits one; reads the models of its protocol."""
        if not found.identity:
            return found
        matching = [model.name for model in self._models_of(installed[found.protocol]) if model.matches(found.identity)]
        candidates = tuple(dict.fromkeys([*matching, *found.candidates]))
        return replace(found, model=matching[0] if len(matching) == 1 else "", candidates=candidates)

    def fitting(self, found: Found) -> Exchange[Found]:
        """Ask a drive for what tells the series of its protocol apart, where that is not its name plate."""
        plugin = installed[found.protocol]
        candidates = yield from fitting(plugin, found.address, self._models_of(plugin))
        return replace(found, candidates=candidates)

    def _first(self, wanted: Callable[[Asking], bool]) -> None:
        # Stable, so that the likely go first among them, too.
        self._left = deque(sorted(self._left, key=lambda each: not wanted(each)))

    def _models_of(self, plugin: Protocol) -> Sequence[Model]:
        if plugin.name not in self._models:
            self._models[plugin.name] = _readable_models(plugin)
        return self._models[plugin.name]

    def _widely(self, plain: Sequence[tuple[Protocol, Mapping[str, Any], int]], choices: LineChoices) -> list[Asking]:
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
                        (order, Asking(protocol=name, address=address, settings=each.settings, variant=variants[key]))
                    )
        return [asking for _, asking in sorted(ranked, key=lambda one: one[0])]


def options_of(settings: LineSettings) -> dict[str, Any]:
    """Return line settings as `Bus.drive` and `open_bus` take them."""
    return asdict(settings)


def scan_plan(only: Iterable[str] | None, addresses: Iterable[int] | None) -> list[tuple[Protocol, int]]:
    """Return whom a scan asks, in order; addresses that a protocol does not have are left out."""
    return [(plugin, address) for plugin, _, address in _asked(only, addresses)]


def _asked(
    only: Iterable[str] | None, addresses: Iterable[int] | None
) -> list[tuple[Protocol, Mapping[str, Any], int]]:
    """Return whom a scan asks, with the drive options that its protocol's name has behind it."""
    if only is not None and (isinstance(only, str) or not isinstance(only, Iterable)):
        raise UsageError(f"protocols cannot be {shortened(only)}; give a list, such as ['vabus']")
    plugins: list[tuple[Protocol, Mapping[str, Any]]]
    plugins = [_variant(each) for each in only] if only is not None else [(each, {}) for each in installed.working()]
    try:
        wanted = None if addresses is None else list(addresses)
    except TypeError:
        raise UsageError(f"addresses cannot be {shortened(addresses)}; give a list of numbers") from None
    return [
        (plugin, variant, address)
        for plugin, variant in plugins
        for address in (wanted if wanted is not None else plugin.scan_addresses)
        if address in plugin.addresses
    ]


def _variant(text: str) -> tuple[Protocol, Mapping[str, Any]]:
    """Return the protocol and the drive options that a scan is told: `toy` or `toy,end=1`. Raises UsageError."""
    name, *options = text.split(",") if isinstance(text, str) else (text,)
    return installed[name], parse_options(options)


def scanning(
    search: Search, member_of: Callable[[Asking], Member], progress: Callable[[str, int, int], None] | None
) -> Iterator[Question | Found]:
    """Yield the questions of a scan, whose answers must be filled in, and the drives that were found by them."""
    asking = None
    for asking in search:
        if progress is not None:
            progress(str(asking), search.done, search.total)
        peer, operations, _ = member_of(asking)
        question = Question(peer, partial(probe, asking, operations, peer.facts.settings))
        yield question
        found = search.heard(asking, question.found)
        if found is not None and found.sound:
            question = Question(peer, partial(identify, found, operations))
            yield question
            found = question.found or found
            question = Question(peer, partial(search.fitting, found))
            yield question
            found = question.found
        if found is not None:
            yield found
    yield from search.damaged()
    if progress is not None and asking is not None:
        progress(str(asking), search.total, search.total)


def probe(asking: Asking, operations: Operations, settings: LineSettings) -> Exchange[Found | None]:
    """Ask one address whether a drive is there; None when nobody answers. settings: those of the line."""
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
    """Let a drive that is there tell what it is."""
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
            # A file of the user's that is no model must not keep drives from being found.
            continue
    return tuple(found)


def _needs_eight_bits(plugin: Protocol, address: int) -> bool:
    """Whether already the question who is there has a byte that seven data bits cannot carry."""
    options = plugin.options()
    exchange = plugin.operations(address, options, None).probe()
    command = next(exchange)
    while not isinstance(command, Ask):
        command = exchange.send(None)
    exchange.close()
    return max(plugin.codec(options).encode(command.message)) > 0x7F
