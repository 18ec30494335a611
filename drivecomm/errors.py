"""Everything that can go wrong, in one tree, branched by who is at fault.

DriveCommError                      exit code 1
├── UsageError                  2   the caller: a wrong name, address, value or file
│   ├── UnknownProtocolError        `drive("profibus", 1)` with no such plug-in installed
│   ├── ProtocolLoadError           a plug-in is installed and cannot be imported
│   ├── AddressError                VABus node 31, FC address 127
│   ├── ParameterAddressError       "48x" is no parameter address
│   ├── ValueRefusedError           six digits for a telegram with room for five
│   ├── NotSupported                DC brake on a drive that has none
│   ├── ReadOnlyError               writing to a drive that the plant does not arm
│   ├── NotAllowedError             a user without the right to command asks a server for a start
│   │   └── TooOftenError           a user reads more values a second than the server allows
│   ├── LeaseError                  somebody else commands the drive now
│   └── FileFormatError             a vector or model file with a missing key
├── LinkError                   3   the line or its port
│   ├── PortError                   the port does not exist or is in use
│   ├── LinkDownError               the adapter was unplugged, the serial server hung up
│   └── ServerLostError             the server that owns the lines has gone, or does not answer
├── ReplyError                  4   the reply is missing or damaged
│   ├── NoReplyError                nothing came in time (also a TimeoutError)
│   │   └── NotAnsweringError       it has not answered for some time, and is not asked now
│   ├── DeadlineError               the call's time was over before it came to an end (also a TimeoutError)
│   │   └── LineBusyError           others had the line until then, and the drive was not asked
│   │       └── HeldBackError       a late reply to an earlier question could be taken for its own
│   ├── OvertakenError              a stop went first, and the reply was not waited for
│   ├── CommandTooOldError          what the drive was commanded is older than its watchdog waits: not repeated
│   ├── DamagedReplyError           something came, no telegram could be made of it
│   ├── UnexpectedReplyError        a sound telegram that answers nothing the drive was asked
│   └── DoubtfulReplyError          sound replies came, and which of them is the drive's to this request is not known
├── DriveError                  5   the drive said no
│   ├── RefusedError                a parameter access was refused, with the drive's code
│   ├── CommandCancelledError       a stop was called after the command, which was not sent
│   ├── WrongDriveError             the drive is not of its model's series, or nothing shows that it is
│   └── StateError                  the drive did not reach the state it was commanded to
└── TelegramError               4   bytes that are no telegram, or fields that make none
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

Category: TypeAlias = Literal["framing", "length", "checksum", "field"]


class DriveCommError(Exception):
    """Root of the tree; every error that drivecomm raises on purpose is one of these."""

    exit_code: ClassVar[int] = 1
    remedy: ClassVar[str] = ""
    """What a person can do about it, for messages that do not say it themselves."""

    says: tuple[str, ...] = ()
    """The words of Python in the sentence and its remedy, such as store=True: where keywords are called otherwise, as
    on the command line, they are shown in the words of that place."""

    about: Mapping[str, str] | None = None
    """The drive that it is about, where whoever has it open says so: `name`, `drive` as PROTOCOL:ADDRESS, `line`."""

    def __init__(self, *told: object, says: str | tuple[str, ...] = ()) -> None:
        super().__init__(*told)
        if says:
            self.says = (says,) if isinstance(says, str) else says


class UsageError(DriveCommError, ValueError):
    """The call cannot work as it stands; nothing was sent."""

    exit_code = 2


class UnknownProtocolError(UsageError):
    """No installed plug-in has this name."""


class ProtocolLoadError(UsageError):
    """An installed plug-in cannot be loaded; the others still work."""


class AddressError(UsageError):
    """The protocol has no drive at this address."""


class ParameterAddressError(UsageError):
    """The text names no parameter in this protocol."""


class ValueRefusedError(UsageError):
    """The value does not fit the parameter: range, digits, decimals or type."""


class NotSupported(UsageError):  # noqa: N818 - the public name since the first plan
    """This drive cannot do that; its capabilities say what it can."""


class ReadOnlyError(UsageError):
    """The drive may be asked and stopped from here, and neither written nor commanded."""


class NotAllowedError(UsageError):
    """Whoever asks has no right to this, or is not known."""


class TooOftenError(NotAllowedError):
    """A server was asked for more values of a line in a short time than it reads for one caller.

    wait_s: in how many seconds it may be asked again.
    """

    def __init__(self, *told: object, wait_s: float = 1.0) -> None:
        super().__init__(*told)
        self.wait_s = wait_s


class LeaseError(UsageError):
    """Somebody else commands the drive now, or the lease under which it was to be commanded is over."""


class FileFormatError(UsageError):
    """A file (vectors, model, values) does not have the form that its reader expects."""


class LinkError(DriveCommError):
    """The line or its port does not work."""

    exit_code = 3


class PortError(LinkError):
    """The port cannot be opened: it does not exist, is in use or refuses its settings."""


class LinkDownError(LinkError):
    """The port worked and has gone; it is opened again by the next exchange."""


class ServerLostError(LinkError):
    """The server that owns the lines has gone, or does not answer; what it was asked to do may have been done."""


class ReplyError(DriveCommError):
    """A drive was asked and no believable reply came.

    others_wait: whether a stop was asking, which others wait to follow; it sends what it can and ends its turn.
    """

    exit_code = 4
    others_wait = False


class NoReplyError(ReplyError, TimeoutError):
    """Nothing that answers the request came within the reply time."""

    remedy = "check its address, its line settings and the wiring, or scan the line"


class NotAnsweringError(NoReplyError):
    """The drive has not answered for some time, so the line was not held up with it; it is asked again soon."""


class DeadlineError(ReplyError, TimeoutError):
    """The call's time was over: while it waited for its turn, for the drive, or between its telegrams."""

    remedy = "give the drive more time with deadline_s=60, or ask for less on this line"
    says = ("deadline_s=60",)


class LineBusyError(DeadlineError):
    """The turn of a call did not come within its time, so nothing was sent: this says nothing about the drive."""


class HeldBackError(LineBusyError):
    """A poll was not sent, because a late reply to an earlier question could be taken for its own.

    until: when it can be, on the clock of the bus.
    """

    def __init__(self, message: str, until: float = 0.0) -> None:
        super().__init__(message)
        self.until = until


class OvertakenError(ReplyError):
    """A stop on this line went first: the drive was not asked any more, or its reply was not waited for."""

    remedy = "try again"


class CommandTooOldError(ReplyError):
    """A command was to be repeated that is older than the drive's watchdog waits; it was not sent, and is forgotten."""


class DamagedReplyError(ReplyError):
    """Bytes came within the reply time, and none of them made a sound telegram."""

    remedy = "check baud rate, parity and termination, and whether two drives have the same address"


class UnexpectedReplyError(ReplyError):
    """The reply is sound and correlates, and still is no answer that this request can have."""

    remedy = "check the type of the parameter and the drive's model"


class DoubtfulReplyError(ReplyError):
    """Sound replies came, and none of them is certain to be the one to this request: another master asks as well."""

    remedy = "end the other master, or the other clients of the gateway, and check it with drivecomm doctor"


class DriveError(DriveCommError):
    """The drive understood and said no."""

    exit_code = 5


class RefusedError(DriveError):
    """The drive refused an access to a parameter.

    parameter: its address. code: the drive's number, None when it gave none. reason: the manual's words for it.
    """

    def __init__(self, parameter: str, code: int | None, reason: str) -> None:
        self.parameter = parameter
        self.code = code
        self.reason = reason
        number = "without a code" if code is None else f"with code {code}"
        super().__init__(f"the drive refused parameter {parameter} {number}: {reason}")


class CommandCancelledError(DriveError):
    """A stop was called after the command, which therefore was not sent, or not sent to its end."""


class WrongDriveError(DriveError):
    """The drive is not of the series of its model, or nothing shows that it is; it was not written or commanded.

    model: the name of that model. found: what the drive told or refused. candidates: the models that it could be of.
    """

    remedy = "compare its name plate; give it its right model, or confirm this one with confirmed=MODEL"
    says = ("confirmed=MODEL",)

    def __init__(self, told: str, model: str = "", found: str = "", candidates: tuple[str, ...] = ()) -> None:
        super().__init__(told)
        self.model, self.found, self.candidates = model, found, candidates


class StateError(DriveError):
    """The drive is in, or came to, a state other than the one that was asked for."""


class TelegramError(DriveCommError):
    """Bytes are not a telegram of this protocol, or fields cannot be made into one.

    category: framing (a fixed character is wrong), length, checksum, or field (a field holds what it may not).
    field: the name of the field at fault, empty when it is the telegram as a whole.
    """

    exit_code = 4

    def __init__(self, category: Category, message: str, *, field: str = "") -> None:
        self.category: Category = category
        self.field = field
        super().__init__(message)


_LONGEST_NAME = 100
"""Longer words are no names, and comparing them takes time that grows with the square of their length."""


def closest(name: object, known: Iterable[str]) -> str:
    """Return the known name that is most like this one, whatever its case; nothing where none is."""
    if not isinstance(name, str) or not 0 < len(name) <= _LONGEST_NAME:
        return ""
    from difflib import get_close_matches

    by_folded = {each.casefold(): each for each in sorted(known, reverse=True)}
    found = get_close_matches(name.casefold(), sorted(by_folded), n=1)
    return by_folded[found[0]] if found else ""


def near(name: object, known: Iterable[str]) -> str:
    """Return a question that names what was perhaps meant, nothing where no known name is like this one."""
    found = closest(name, known)
    return f"did you mean {found!r}?" if found else ""


def meant(name: object, known: Iterable[str], listed: str) -> str:
    """Return what was perhaps meant, as `near` asks it, and all that there is.

    listed: the words before the names, which end the sentence, such as "it has".
    """
    names = list(known)
    there = f"{listed} {', '.join(names) or 'none'}"
    question = near(name, names)
    return f"{question} {there[0].upper()}{there[1:]}" if question else there


def unknown_key(key: str, known: Iterable[str]) -> str:
    """Return the words for a key that a file must not have: what was probably meant, or all keys that there are."""
    names = list(known)
    return f"unknown key {key!r}; {near(key, names) or 'the keys are ' + ', '.join(names)}"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, such as "1 drive" and "2 drives"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def printable(text: str) -> str:
    r"""Return a text with all that would command a terminal or break a line as escapes, such as \x1b and \u202e.

    For text of others (callers, brokers, drives, files) on its way to a terminal, a log or an event.
    """
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)


def in_one_line(error: BaseException) -> str:
    """Return what an error says without line breaks and control characters, its kind where it says nothing."""
    return printable(" ".join(str(error).split())) or type(error).__name__


def reason_of(error: Exception) -> str:
    """Return why something failed in the system's words, without what Python adds to them: the address again."""
    said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return said.partition(" (while attempting")[0]


def shortened(name: object) -> str:
    """Return a name as a message shows it, in quotes; a very long one is cut."""
    try:
        text = repr(name)
    except ValueError:
        # Python writes no whole number of more than 4300 digits.
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST_NAME else f"{text[:_LONGEST_NAME]}..."
