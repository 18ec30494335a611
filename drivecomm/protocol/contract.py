"""The plug-in contract: the objects that a protocol package provides to drivecomm.

A package has one `Protocol` object, named by the entry-point group `drivecomm.protocols`. All other objects are reached
from there. The `Protocol` object and all objects that it refers to do no I/O, read no clock and import nothing that
does.
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
    """Purpose of a request.

    access: whether the request reads or writes a parameter; empty for neither. A command that is given by writing a
    parameter is a write. commands: whether the request also commands the drive, for example with a control word that
    the drive obeys; one telegram may do both. prepares: whether the request only decides the meaning of the next
    requests to this drive, such as the choice of a page.
    """

    access: Literal["", "read", "write"] = ""
    commands: bool = False
    prepares: bool = False

    @property
    def only_asks(self) -> bool:
        """True if the request changes nothing in any state of the drive, so that any program may repeat it."""
        return self.moves_nothing and not self.prepares

    @property
    def moves_nothing(self) -> bool:
        """True if the request neither commands nor writes, so that a program with read access may send it."""
        return self.access != "write" and not self.commands


@dataclass(frozen=True, slots=True, kw_only=True)
class Capabilities:
    """Operations that a drive supports over this protocol.

    stops: the ways to stop. reverse: whether it can start backwards. reference_percent, reference_hz: whether a
    reference can be given in this unit. reference_limit: the largest reference, in per cent of the reference range.
    reference_limit_hz: the frequency at that limit, None if no option states it. reference_maximum: the parameter with
    the highest frequency of the drive, which is read before a reference in hertz is sent; empty if the operations limit
    the reference themselves, or no such parameter is known. stored_writes: `store=True` writes to EEPROM.
    volatile_writes: `store=False` keeps a write out of EEPROM. broadcast: whether one telegram can command all drives.
    faults: whether the drive reports that it has tripped, and can be reset; if not, `DriveStatus.fault` is always
    False, and a trip looks like a stop. monitoring_only: the model of its series has no commands, so that the drive is
    read and never commanded: start, stop, reset, references and writes to command registers raise NotSupported.

    The `Drive` object fills in the rest. verbs: the common verbs that it has in addition (jog, hold, select_setup,
    select_preset, set_relay), from `Operations.extra`. link_loss: a sentence from its model that says what the drive
    does when the master falls silent, and which parameter decides it.
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
    """State that a master keeps about one drive, such as the last control word; one object for each drive and bus.

    All `Drive` objects of the drive share it, so that none of them sends again a command that another one has replaced
    (`drivecomm.link.command_order`).
    """

    def forget(self) -> None:
        """Forget the last command, which must not be sent again: a stop was called, or the drive was unreachable."""

    def watch(self, silence_s: float | None) -> None:
        """Set the number of seconds for which the drive's watchdog waits; None if the watchdog is off or unknown.

        `status` has to repeat the last command only while the watchdog is on.
        """


LINE_ERROR = "line error"
"""Name of the mismatch when a reply reports that the drive did not understand the request (`Protocol.line_errors`)."""

DESCRIBE = "describe"
"""Name of the verb in `Operations.extra` that reads the description of a parameter from the drive."""


class Operations(Interface):
    """Operations of one drive, or of all drives at the broadcast address, as exchanges.

    The state of the drive is kept in the `Memory` with which the operations were made. An unsupported operation raises
    NotSupported before anything is sent; a value that does not fit raises ValueRefusedError. Further keywords of `read`
    and `write` belong to the protocol and to its documentation.
    """

    @property
    def capabilities(self) -> Capabilities:
        """Operations that this drive supports."""

    @property
    def read(self) -> Callable[..., Exchange[Reading]]:
        """`read(parameter, **own options)`: read one parameter, by its address or by its name in the model."""

    @property
    def write(self) -> Callable[..., Exchange[Reading | None]]:
        """`write(parameter, value, *, store=False, **own options)`: write one parameter.

        The result is the value that the drive then reports, or None if the drive only confirms the write.
        """

    def address_of(self, parameter: str, **options: Any) -> str:
        """Return the address of the value that `write` would change, as the same text for every name of that value.

        options: the options of `write`, which may name an index or a data set. Raises ParameterAddressError as `write`
        does.
        """

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """Further verbs by name, for `Drive.call`.

        Some have the same names and arguments in every protocol, and are methods of `Drive`: jog(number), hold(),
        select_setup(number), select_preset(number), set_relay(number, on).
        """

    def status(self) -> Exchange[DriveStatus]:
        """Read the status word.

        If the status allows it, the request may repeat the last command for the drive's watchdog.
        """

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
        """Send one request that cannot move a motor; return if a drive of this protocol answers it."""

    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:
        """Read the identity of the drive: name plate, software, address. Moves nothing; the result may be empty.

        only: the entries to read, all if empty; the result may hold further entries.
        """


@runtime_checkable
class ReadsMany(Interface):
    """Further operations if one telegram can read several parameters of a drive.

    Each telegram is an exchange of its own, so that other callers may use the line between two telegrams. Each reading
    has the time of its own telegram.
    """

    def blocks(self, parameters: Sequence[str]) -> Sequence[Sequence[int]]:
        """Return groups of parameters that one telegram each can read, as positions in the list, each position once.

        Sends nothing. Raises the errors of `read` for a parameter that can never be read.
        """

    def read_many(self, parameters: Sequence[str]) -> Exchange[Sequence[Reading]]:
        """Read one group that `blocks` returned, by one telegram; the readings are in the order of the parameters.

        A refusal applies to the whole group, since the drive does not say which parameter it refuses. The caller should
        try smaller groups.
        """


@runtime_checkable
class KnowsStarts(Interface):
    """Further operation that knows which calls may start a motor.

    Without this operation, every verb of `Operations.extra` counts as a start, and no write does.
    """

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Return whether a call may start a motor at standstill; True if that depends on the settings of the drive.

        verb: "write", with parameter and value in the arguments, or a verb of `Operations.extra`. References, stops,
        resets and read requests start nothing. Sends nothing; may raise the errors of the call itself.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesFound:
    """Evidence from a drive about its series.

    against: the reason why the drive does not fit its model, as a sentence without a full stop; empty if there is none.
    open: the names of other models that fit as well. candidates: the models that fit, if there is a reason against its
    own model.
    """

    against: str = ""
    open: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()


@runtime_checkable
class KnowsSeries(Interface):
    """Further operation of drives whose commands depend on the model, so that another series acts differently on them.

    Without this operation, all drives of the protocol understand the same commands.
    """

    def check_series(self, others: Sequence[Model]) -> Exchange[SeriesFound]:
        """Read the values that distinguish the series of the drive's model from others. Only reads.

        others: the models of the protocol to which the drive could belong.
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

    - name: as in `PROTOCOL:ADDRESS`.
    - title: maker and protocol, for people.
    - package: the Python package that holds vectors.toml, models/ and README.md.
    - facts: default line settings and timing, with their source in `facts_source`.
    - line_sources: the manual and page of each of these numbers that a maker demands of a master, by the name of the
      fact or `silence_characters`. A master that breaks such a number is at fault. The other numbers are defaults.
    - unanswered: the kinds of request that no drive answers.
    - addresses: the addresses of single drives, in order, as a range or a tuple.
    - scan_addresses: the addresses that a scan probes by default.
    - addresses_of: returns the addresses of drives with these options, if they depend on the options.
    - default_model: the model of the package whose parameters a virtual drive holds by default.
    - broadcast_address: the address that means all drives to `operations`; None if the protocol has no broadcast.
    - options: a frozen keyword-only dataclass of the differences between drives and decoders of this protocol; its
      docstring explains each option.
    - codec: returns the codec of the telegrams for these options.
    - message: builds a message from fields as vectors name them.
    - mismatch: names the first field in which a sound reply does not belong to the request, empty if the reply belongs
      to it; depends on nothing but these two messages.
    - operations: returns the verbs for a drive at an address, with its options and its model.
    - memory: makes the state that a master keeps about one drive, which is a further argument of `operations`; None if
      no state is kept.
    - virtual: makes a virtual drive.
    - blind_spots: the positions in a telegram where the protocol cannot detect a single wrong bit. By default there are
      none, because the check characters cover all positions.
    - forms: the forms of all its telegrams by title, for documentation, drawings and checks.
    - parameter_examples: parameter addresses that show the address forms of this protocol.
    - control_profiles: the profiles of `drivecomm.profiles` by which drives are commanded, for checks by the
      conformance kit; empty if each model has its own.
    - intent: returns the purpose of a request. If it is None, every request counts as a command, and a fault script
      cannot distinguish the replies to reads and writes.
    - parameter_keys: keys of a model's parameters that only this protocol uses, such as `datasets`. If it is None, a
      misspelt key of a parameter goes unnoticed.
    - control_keys: keys of a model's table [control], if the model decides how its drives are commanded; the package
      finds them in `Model.control`.
    - same_commands: whether drives of all models are nevertheless commanded alike, so that the stop of one model is
      right for all.
    - element_addresses: returns the addresses under which the values of a parameter are read one by one (data sets,
      array elements), for these options; by default every parameter has one value.
    - factory_reading: the options of `read` with which a drive returns the factory value of a parameter; empty if
      drives do not report it.
    - plain_writing: the options of `write` with which a value is the number of `Reading.raw`, for parameters whose
      scale depends on more than the model and may be unknown; empty if there are no such options.
    - ambiguous_with: the protocols with telegrams that are also sound requests of this protocol to the same address, so
      that a drive of this protocol may obey a telegram for a drive of the other. By name, with the effect as a sentence
      without a full stop, which `cohabit` shows.
    - silence_characters: after a silence of this many characters, a drive takes the next byte as the beginning of a
      telegram, whatever it received before, unless a gap is chosen for the drive; 0 if the drive waits as long as a
      master (`Timing.gap_s`).
    - references: returns the addresses of the parameters that the verbs write as a reference, for these options and
      this model. They hold the last command of a bus, so they are not settings to back up.
    - line_errors: codes by which a drive reports that it did not understand a request (a wrong check character, an
      overrun), by the field of the reply that holds them. Such a reply counts as damaged, and the request is repeated
      as often as an unanswered one, unless the `Ask` names `LINE_ERROR` in `besides`.
    - wrong_settings: the effect on a drive of requests at wrong line settings, as a sentence that a scan shows before
      it tries several settings; empty if such requests have no effect.
    - address_space: returns the addresses that a drive with these options and this model (None if it is unknown) may
      hold, for callers that read them one by one; None if the package does not state them.
    - schemes: the schemes of ports that carry only this protocol, with the options of the drives behind them.
    - refusals: returns the codes with which drives with these options and this model (None if it is unknown) refuse a
      request, as in `RefusedError.code`, with their meanings; empty if the package does not state them.
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
