"""Every error of drivecomm in one tree, grouped by cause.

DriveCommError                      exit code 1
├── UsageError                  2   the caller: a wrong name, address, value or file
│   ├── UnknownProtocolError        `drive("profibus", 1)` without such a plug-in
│   ├── ProtocolLoadError           an installed plug-in cannot be imported
│   ├── AddressError                VABus node 31, FC address 127
│   ├── ParameterAddressError       "48x" is not a parameter address
│   ├── ValueRefusedError           six digits for a telegram with room for five
│   ├── NotSupported                DC brake on a drive without one
│   ├── ReadOnlyError               writing to a drive that the plant does not arm
│   ├── NotAllowedError             a user without the right to command requests a start
│   │   └── TooOftenError           a user reads more values a second than the server allows
│   ├── LeaseError                  another user or program commands the drive now
│   └── FileFormatError             a vector or model file with a missing key
├── LinkError                   3   the line or its port
│   ├── PortError                   the port does not exist or is in use
│   ├── LinkDownError               the adapter was unplugged, the serial server hung up
│   └── ServerLostError             the server that owns the lines has gone or does not answer
├── ReplyError                  4   the reply is missing or damaged
│   ├── NoReplyError                nothing came in time (also a TimeoutError)
│   │   └── NotAnsweringError       the drive has been silent for some time: no request is sent now
│   ├── DeadlineError               the call's time ran out before it ended (also a TimeoutError)
│   │   └── LineBusyError           other calls had the line all that time: nothing was sent
│   │       └── HeldBackError       a late reply to an earlier request could be mistaken for its own
│   ├── OvertakenError              a stop went first, and the reply was not awaited
│   ├── CommandTooOldError          a command older than the drive's watchdog time is not repeated
│   ├── DamagedReplyError           bytes came, but they are not a sound telegram
│   ├── UnexpectedReplyError        a sound telegram, but not a possible reply to the request
│   └── DoubtfulReplyError          sound replies came, but none is certainly the reply to this request
├── DriveError                  5   the drive refused
│   ├── RefusedError                a parameter access was refused, with the drive's code
│   ├── CommandCancelledError       a stop was called after the command, so it was not sent
│   ├── WrongDriveError             the drive is not of its model's series, or nothing shows that it is
│   └── StateError                  the drive did not reach the state it was commanded to
└── TelegramError               4   bytes or fields that do not form a telegram
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

Category: TypeAlias = Literal["framing", "length", "checksum", "field"]


class DriveCommError(Exception):
    """Base class of every error that drivecomm raises on purpose."""

    exit_code: ClassVar[int] = 1
    remedy: ClassVar[str] = ""
    """What the user can do about the error. Empty if the message already says it."""

    says: tuple[str, ...] = ()
    """Python expressions quoted in the message or the remedy, such as store=True.

    An interface with other words for them, such as the command line, shows its own words instead.
    """

    about: Mapping[str, str] | None = None
    """The drive that the error concerns, with `name`, `drive` as PROTOCOL:ADDRESS, and `line`.

    None unless the code that opened the drive sets it.
    """

    def __init__(self, *told: object, says: str | tuple[str, ...] = ()) -> None:
        super().__init__(*told)
        if says:
            self.says = (says,) if isinstance(says, str) else says


class UsageError(DriveCommError, ValueError):
    """The call cannot work as it is written; nothing was sent."""

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
    """The drive cannot do this; its capabilities list what it can do."""


class ReadOnlyError(UsageError):
    """The drive may be read and stopped from here, but not written or commanded."""


class NotAllowedError(UsageError):
    """The caller is unknown, or may not do this."""


class TooOftenError(NotAllowedError):
    """A caller requested more values of a line in a short time than the server reads for one caller.

    wait_s: seconds until the server accepts the next request.
    """

    def __init__(self, *told: object, wait_s: float = 1.0) -> None:
        super().__init__(*told)
        self.wait_s = wait_s


class LeaseError(UsageError):
    """Another user or program commands the drive now, or the lease of this command has expired."""


class FileFormatError(UsageError):
    """A file (vectors, model, values) does not have the form that its reader expects."""


class LinkError(DriveCommError):
    """The line or its port does not work."""

    exit_code = 3


class PortError(LinkError):
    """The port cannot be opened: it does not exist, is in use or refuses its settings."""


class LinkDownError(LinkError):
    """The port worked and was then lost; the next exchange opens it again."""


class ServerLostError(LinkError):
    """The server that owns the lines has gone or does not answer. It may have carried out the request."""


class ReplyError(DriveCommError):
    """A request was sent to a drive, and no believable reply came.

    others_wait: True if a stop failed while other stops waited for the line. It then ends its turn early.
    """

    exit_code = 4
    others_wait = False


class NoReplyError(ReplyError, TimeoutError):
    """No reply to the request came within the reply time."""

    remedy = "check its address, its line settings and the wiring, or scan the line"


class NotAnsweringError(NoReplyError):
    """The drive has not answered for some time, so no request was sent. It is tried again soon."""


class DeadlineError(ReplyError, TimeoutError):
    """The call's time ran out: while it waited for its turn, for the drive, or between its telegrams."""

    remedy = "give the drive more time with deadline_s=60, or ask for less on this line"
    says = ("deadline_s=60",)


class LineBusyError(DeadlineError):
    """The call did not get its turn in time, so nothing was sent. This says nothing about the drive."""


class HeldBackError(LineBusyError):
    """A poll was not sent, because a late reply to an earlier request could be mistaken for the reply to it.

    until: earliest time to send it, in seconds on the clock of the bus.
    """

    def __init__(self, message: str, until: float = 0.0) -> None:
        super().__init__(message)
        self.until = until


class OvertakenError(ReplyError):
    """A stop on this line went first: the request was not sent, or its reply was not awaited."""

    remedy = "try again"


class CommandTooOldError(ReplyError):
    """A command due for repetition is older than the drive's watchdog time. It was not sent, and is forgotten."""


class DamagedReplyError(ReplyError):
    """Bytes came within the reply time, but no sound telegram was among them."""

    remedy = "check baud rate, parity and termination, and whether two drives have the same address"


class UnexpectedReplyError(ReplyError):
    """The reply is sound and belongs to the request, but is not one that this request can have."""

    remedy = "check the type of the parameter and the drive's model"


class DoubtfulReplyError(ReplyError):
    """Sound replies came, but none is certainly the reply to this request.

    It may belong to an earlier request, or to the request of another master.
    """

    remedy = "end the other master, or the other clients of the gateway, and check it with drivecomm doctor"


class DriveError(DriveCommError):
    """The drive understood the request and refused it."""

    exit_code = 5


class RefusedError(DriveError):
    """The drive refused access to a parameter.

    parameter: its address. code: the drive's error number; None if it gave none. reason: the manual's words for the
    code.
    """

    def __init__(self, parameter: str, code: int | None, reason: str) -> None:
        self.parameter = parameter
        self.code = code
        self.reason = reason
        number = "without a code" if code is None else f"with code {code}"
        super().__init__(f"the drive refused parameter {parameter} {number}: {reason}")


class CommandCancelledError(DriveError):
    """A stop was called after the command, so the command was not sent, or only in part."""


class WrongDriveError(DriveError):
    """The drive is not of its model's series, or nothing shows that it is; it was not written or commanded.

    model: name of the model. found: what the drive reported or refused. candidates: models that the drive could be of.
    """

    remedy = "compare its name plate; give it its right model, or confirm this one with confirmed=MODEL"
    says = ("confirmed=MODEL",)

    def __init__(self, told: str, model: str = "", found: str = "", candidates: tuple[str, ...] = ()) -> None:
        super().__init__(told)
        self.model, self.found, self.candidates = model, found, candidates


class StateError(DriveError):
    """The drive is in, or reached, a state other than the requested one."""


class TelegramError(DriveCommError):
    """The bytes are not a telegram of this protocol, or the fields cannot be made into one.

    category: framing (a fixed character is wrong), length, checksum, or field (a field holds an invalid value). field:
    name of the wrong field; empty if the whole telegram is wrong.
    """

    exit_code = 4

    def __init__(self, category: Category, message: str, *, field: str = "") -> None:
        self.category: Category = category
        self.field = field
        super().__init__(message)


_LONGEST_NAME = 100
"""Maximum length of a name, in characters. Comparing longer words takes quadratic time."""


def closest(name: object, known: Iterable[str]) -> str:
    """Return the known name most similar to this one, ignoring case; empty if none is similar."""
    if not isinstance(name, str) or not 0 < len(name) <= _LONGEST_NAME:
        return ""
    from difflib import get_close_matches

    by_folded = {each.casefold(): each for each in sorted(known, reverse=True)}
    found = get_close_matches(name.casefold(), sorted(by_folded), n=1)
    return by_folded[found[0]] if found else ""


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return a "did you mean" question with the most similar known name; empty if none is similar."""
    found = closest(name, known)
    return f"did you mean {found!r}?" if found else ""


def suggestion(name: object, known: Iterable[str], listed: str) -> str:
    """Return the question of `did_you_mean`, followed by the list of all known names.

    listed: words before the list, such as "it has".
    """
    names = list(known)
    there = f"{listed} {', '.join(names) or 'none'}"
    question = did_you_mean(name, names)
    return f"{question} {there[0].upper()}{there[1:]}" if question else there


def unknown_key(key: str, known: Iterable[str]) -> str:
    """Return the message for an unknown key in a file: a similar key if there is one, otherwise all known keys."""
    names = list(known)
    return f"unknown key {key!r}; {did_you_mean(key, names) or 'the keys are ' + ', '.join(names)}"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, such as "1 drive" and "2 drives"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def printable(text: str) -> str:
    r"""Return the text with control characters and line breaks as escapes, such as \x1b and \u202e.

    Use it for text from outside (callers, brokers, drives, files) that goes to a terminal, a log or an event.
    """
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)


def in_one_line(error: BaseException) -> str:
    """Return the message of an error without line breaks and control characters; its class name if it has none."""
    return printable(" ".join(str(error).split())) or type(error).__name__


def reason_of(error: Exception) -> str:
    """Return the system's reason for a failure, without the address that Python repeats in it."""
    said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return said.partition(" (while attempting")[0]


def shortened(name: object) -> str:
    """Return the quoted name for a message, cut if it is very long."""
    try:
        text = repr(name)
    except ValueError:
        # Python refuses to print an integer of more than 4300 digits.
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST_NAME else f"{text[:_LONGEST_NAME]}..."
