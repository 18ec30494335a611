"""The plug-in contract: what a protocol package gives to drivecomm.

A package has one `Protocol` object, named by the entry-point group `drivecomm.protocols`. Everything else is found from
there. The object and all it refers to do no I/O, read no clock and import nothing that does.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING, Any, Literal, Protocol as Interface, runtime_checkable

from drivecomm.protocol.status import Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from drivecomm.protocol.address_space import AddressSpace
    from drivecomm.protocol.exchange import Exchange
    from drivecomm.protocol.framing import Codec
    from drivecomm.protocol.line import LineFacts
    from drivecomm.protocol.model import Model, ParameterInfo
    from drivecomm.protocol.reading import Reading, Value
    from drivecomm.protocol.schema import Form
    from drivecomm.protocol.status import DriveStatus
    from drivecomm.protocol.telegram import Direction, Message
    from drivecomm.protocol.virtual_drive import VirtualDrive


@dataclass(frozen=True, slots=True, kw_only=True)
class Intent:
    """What a request is for.

    access: whether it reads or writes a parameter. commands: whether it commands the drive besides, as with a control
    word that the drive obeys. One telegram may do both; what is commanded by writing a parameter is a write. prepares:
    whether it does nothing but decide what the next requests to this drive mean, such as the choice of a page.
    """

    access: Literal["", "read", "write"] = ""
    commands: bool = False
    prepares: bool = False

    @property
    def only_asks(self) -> bool:
        """Whether it changes nothing, whatever state its drive is in, so that anybody may send it again."""
        return self.moves_nothing and not self.prepares

    @property
    def moves_nothing(self) -> bool:
        """Whether it neither commands nor writes, so that who may only look may send it."""
        return self.access != "write" and not self.commands


@dataclass(frozen=True, slots=True, kw_only=True)
class Capabilities:
    """What a drive can be asked to do over this protocol.

    stops: the ways to stop. reverse: whether it can start backwards. reference_percent, reference_hz: how a reference
    can be given. reference_limit: the largest share of the reference range that a reference may ask for, in per cent.
    reference_limit_hz: the frequency of that share, None if no option says it. reference_maximum: the parameter with
    the highest frequency of the drive, to be read before a reference in hertz is sent; empty if the operations bound it
    themselves, or none is known. stored_writes: `store=True` writes to EEPROM. volatile_writes: `store=False` keeps a
    write out of EEPROM. broadcast: commands to all drives at once. faults: whether it tells that it has tripped, and
    can be reset; of one that does not, `DriveStatus.fault` is always False, and a trip looks like a stop.
    monitoring_only: the model of its series has no orders, so that it is read and never commanded: start, stop, reset,
    references and writes to command registers raise NotSupported.

    The drive itself fills in the rest: verbs: which of the common verbs it has besides (jog, hold, select_setup,
    select_preset, set_relay), from `Operations.extra`; link_loss: what it does when the master falls silent and which
    parameter decides it, as a sentence, from its model.
    """

    stops: frozenset[Stop]
    reverse: bool
    reference_percent: bool
    reference_hz: bool
    stored_writes: bool
    volatile_writes: bool
    broadcast: bool
    faults: bool = True
    monitoring_only: bool = False
    reference_limit: Decimal = Decimal(100)
    reference_limit_hz: Decimal | None = None
    reference_maximum: str = ""
    verbs: frozenset[str] = frozenset()
    link_loss: str = ""


class Memory(Interface):
    """What a master must remember of one drive: the control word it last sent, say. One for each drive and bus.

    All objects for the drive share it, so that none of them brings back a command that another has replaced
    (`drivecomm.link.command_order`).
    """

    def forget(self) -> None:
        """Forget what was commanded: a stop was called, or the drive was away. It must not be sent again."""

    def watch(self, silence_s: float | None) -> None:
        """Take note that the drive's watchdog waits so long for the master; None when it is off, or not known.

        Only where it is on `status` has to repeat what was commanded.
        """


LINE_ERROR = "line error"
"""In what a reply differs by which a drive says that it did not understand the request (`Protocol.line_errors`)."""

DESCRIBE = "describe"
"""The verb of `Operations.extra` by which drives tell what a parameter is; it only reads."""


class Operations(Interface):
    """The operations of one drive, or of all drives at the broadcast address, as exchanges.

    What must be remembered of the drive is in the `Memory` that they were made with. What cannot be done raises
    NotSupported before anything is sent; a value that does not fit raises ValueRefusedError. The keywords of `read` and
    `write` beyond those here are the protocol's own and are part of its documentation.
    """

    @property
    def capabilities(self) -> Capabilities:
        """What this drive can be asked to do."""

    @property
    def read(self) -> Callable[..., Exchange[Reading]]:
        """`read(parameter, **own options)`: read one parameter, by its address or by its name in the model."""

    @property
    def write(self) -> Callable[..., Exchange[Reading | None]]:
        """`write(parameter, value, *, store=False, **own options)`: write one parameter.

        The result is what the drive then reports, None where it only confirms.
        """

    def address_of(self, parameter: str, **options: Any) -> str:
        """Return the address of the value that `write` would change, one text for every way to name it.

        options: those of `write`; they may name an index or a data set. Raises ParameterAddressError as `write` does.
        """

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """Further verbs, by name; `Drive.call` reaches them.

        Some have names and arguments that are the same everywhere, and are methods of `Drive`: jog(number),
        hold(), select_setup(number), select_preset(number), set_relay(number, on).
        """

    def status(self) -> Exchange[DriveStatus]:
        """Read the status word. It may repeat what was commanded, for the drive's watchdog, if the status allows it."""

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start the motor."""

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop the motor."""

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault; the motor stays stopped."""

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the reference as a share of the reference range; it is never stored."""

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the reference as an output frequency; it is never stored."""

    def probe(self) -> Exchange[None]:
        """Ask once, with something that cannot move a motor; returns when a drive of this protocol is there."""

    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:
        """Read what the drive tells of itself: name plate, software, address. Moves nothing; may be empty.

        only: the entries that are wanted, all if empty; others may come with them.
        """


@runtime_checkable
class ReadsMany(Interface):
    """What operations have besides where one telegram can read several parameters of a drive.

    Each telegram is an exchange of its own, so that others may use the line between two of them, and each reading has
    the time of its own telegram.
    """

    def blocks(self, parameters: Sequence[str]) -> Sequence[Sequence[int]]:
        """Return which of these parameters one telegram each reads, by their places in the list, each place once.

        Sends nothing. Raises what `read` raises for a parameter that can never be read.
        """

    def read_many(self, parameters: Sequence[str]) -> Exchange[Sequence[Reading]]:
        """Read parameters that `blocks` has put together, by one telegram; the readings are in the order asked for.

        A refusal is of all of them, since the drive does not say which one it means: whoever asks tries fewer.
        """


@runtime_checkable
class KnowsStarts(Interface):
    """What operations have besides if they know which of their calls may start a motor.

    Of operations without it every verb of `Operations.extra` counts as a start, and no write does.
    """

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Return whether a call may start a motor that stands; True if that depends on how the drive is set.

        verb: "write", with parameter and value in the arguments, or one of `Operations.extra`. A reference starts
        nothing, nor does what stops, resets or only asks. Sends nothing, and may raise what the call would raise.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesFound:
    """What a drive showed of its series.

    against: what speaks against its model, as a sentence without its end; empty if nothing does. open: the other models
    that fit as well, by name. candidates: where something speaks against its model, the models that fit.
    """

    against: str = ""
    open: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()


@runtime_checkable
class KnowsSeries(Interface):
    """What operations have besides whose commands are the model's own, so that those of another series do other things.

    Of operations without it every drive of the protocol understands the same commands.
    """

    def check_series(self, others: Sequence[Model]) -> Exchange[SeriesFound]:
        """Ask the drive for what tells its model's series from others; reads only.

        others: the models of the protocol that it could be of.
        """


def _one_value(info: ParameterInfo, _options: Any) -> tuple[str, ...]:
    return (info.address,)


def _none(_options: Any, _model: Model | None) -> frozenset[str]:
    return frozenset()


def _no_codes(_options: Any, _model: Model | None) -> Mapping[int, str]:
    return {}


def _nowhere(_data: bytes, _direction: Direction) -> frozenset[int]:
    return frozenset()


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Protocol:
    """One drive protocol.

    name: as in `PROTOCOL:ADDRESS`. title: maker and protocol for people. package: the Python package that holds
    vectors.toml, models/ and README.md. facts: default line settings and timing, with their source in `facts_source`.
    line_sources: the manual and page of each number among them that a maker demands of a master, by the name of the
    fact or `silence_characters`; a master is at fault that breaks such a number. The others are defaults.
    unanswered: the kinds of request that no drive answers.
    addresses: those a single drive can have, in order, as a range or a tuple. scan_addresses: those a scan asks unless
    told otherwise. addresses_of: those that a drive with these options can have, where that depends on them.
    default_model: the model of the package whose parameters a virtual drive holds unless told otherwise.
    broadcast_address: None where there is none; otherwise what `operations` takes to mean all drives.
    options: frozen keyword-only dataclass of what differs between drives and decoders of this protocol; its docstring
    explains each. codec: telegrams for these options. message: builds a message from fields as vectors name them.
    mismatch: names the first field in which a sound reply does not belong to the request, empty when it belongs; it
    goes by nothing but the two. operations: the verbs for a drive at an address, with its options and its model.
    memory: makes what a master remembers of one drive, a further argument of `operations`; None where nothing is
    remembered. virtual: a drive to talk to.
    blind_spots: positions in a telegram where the protocol cannot notice a single wrong bit; unless a package says
    otherwise, its check characters cover all.
    forms: the forms of all its telegrams by title, for documentation, drawings and checks.
    parameter_examples: parameter addresses that show the forms of this protocol.
    control_profiles: those of `drivecomm.profiles` that drives are commanded by, for the conformance kit to look over;
    none where each model has its own.
    intent: what a request is for; None where a package does not tell, and then every request counts as a command, and
    a fault script cannot tell the replies to reads and writes apart.
    parameter_keys: keys of a model's parameters that only this protocol knows, such as `datasets`; None where a package
    does not tell, and then a misspelt key of a parameter goes unnoticed.
    control_keys: keys of a model's table [control], for a protocol that leaves it to the model how its drives are
    commanded; the package finds them in `Model.control`. same_commands: whether drives of all models are commanded
    alike all the same, so that the stop of one is right for all.
    element_addresses: under which addresses the values of a parameter are read one by one (data sets, array elements),
    for these options; unless a package says otherwise, every parameter has one value.
    factory_reading: the options of `read` with which a drive tells a parameter's factory value instead of its value;
    empty where drives do not tell.
    plain_writing: the options of `write` with which a value is the number that `Reading.raw` shows, for parameters
    whose scale depends on more than the model and may not be known; empty where there is no such thing.
    ambiguous_with: the protocols that have telegrams which are also sound requests of this one, to the same address,
    so that a drive of this one may obey what is meant for a drive of the other; by name, with what that does, as a
    sentence without an end that `cohabit` shows.
    silence_characters: after a silence of so many characters a drive takes what comes for the beginning of a telegram,
    whatever it heard before, unless a gap is chosen for it; 0 where it waits as long as a master does (`Timing.gap_s`).
    references: the addresses of the parameters that the verbs write as a reference, for these options and this model:
    what they hold is what a bus commanded last, and no setting to back up.
    line_errors: codes by which a drive says that it did not understand a request (a wrong check character, an overrun),
    by the field of a reply that has them; such a reply is taken for a damaged one, and the request is sent again as
    often as one that nobody answers, unless the `Ask` names `LINE_ERROR` among its `besides`.
    wrong_settings: what questions at wrong line settings do to a drive, as a sentence that a scan says before it tries
    several; empty where drives do not mind.
    address_space: which addresses a drive with these options and this model (None where it is not known) may hold, for
    those who ask it address by address; None where a package does not tell.
    schemes: the schemes of ports that carry this protocol only, and the options that its drives have behind them.
    refusals: with which codes drives with these options and this model (None where it is not known) refuse a request,
    as `RefusedError.code` has them, and what each means; empty where a package does not tell.
    """

    name: str
    title: str
    package: str
    facts: LineFacts
    facts_source: str
    addresses: Sequence[int]
    scan_addresses: Sequence[int]
    default_model: str
    broadcast_address: int | None
    options: type[Any]
    codec: Callable[[Any], Codec]
    message: Callable[[Mapping[str, Any], Direction], Message]
    mismatch: Callable[[Message, Message], str]
    operations: Callable[..., Operations]
    virtual: Callable[[int, Any, Model], VirtualDrive]
    forms: Callable[[], Mapping[str, Form[Any]]]
    line_sources: Mapping[str, str] = field(default_factory=dict, hash=False)
    unanswered: frozenset[str] = frozenset()
    addresses_of: Callable[[Any], Sequence[int]] | None = None
    blind_spots: Callable[[bytes, Direction], frozenset[int]] = _nowhere
    parameter_examples: tuple[str, ...] = field(default=())
    control_profiles: Callable[[], tuple[Any, ...]] = tuple
    intent: Callable[[Message], Intent] | None = None
    parameter_keys: frozenset[str] | None = None
    control_keys: frozenset[str] = frozenset()
    same_commands: bool = False
    element_addresses: Callable[[ParameterInfo, Any], tuple[str, ...]] = _one_value
    factory_reading: Mapping[str, Any] = field(default_factory=dict, hash=False)
    memory: Callable[[], Memory] | None = None
    plain_writing: Mapping[str, Any] = field(default_factory=dict, hash=False)
    ambiguous_with: Mapping[str, str] = field(default_factory=dict, hash=False)
    silence_characters: float = 0.0
    references: Callable[[Any, Model | None], frozenset[str]] = _none
    address_space: Callable[[Any, Model | None], AddressSpace] | None = None
    line_errors: Mapping[str, frozenset[object]] = field(default_factory=dict, hash=False)
    wrong_settings: str = ""
    schemes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict, hash=False)
    refusals: Callable[[Any, Model | None], Mapping[int, str]] = _no_codes

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {self.title}>"
