"""Receivers of alarms: webhooks, commands on this machine, and all services of apprise, such as e-mail.

Each receiver gets a message as JSON and returns the reason for a failed delivery, empty on success.
"""

from __future__ import annotations

import base64
import http.client
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from socket import SHUT_RDWR
from threading import Timer
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias
from urllib.parse import unquote, urlsplit

from drivecomm.errors import UsageError, did_you_mean
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

Message: TypeAlias = "Mapping[str, Any]"

_SECRET = re.compile(r"@([A-Za-z0-9_-]+)")
_ENVIRONMENT = "DRIVECOMM_ALARM_"


class AlarmReceiver(Protocol):
    """A receiver of alarm messages. label: names it without any secret."""

    @property
    def label(self) -> str:
        """The name of the receiver in events."""

    def problem(self) -> str:
        """Return the reason why no delivery can succeed, empty if one may; may take seconds."""

    def deliver(self, message: Message, within_s: float) -> str:
        """Deliver a message within the time limit; return the reason for failure, or "" on success."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WebhookReceiver:
    """A URL that takes the message as the body of a POST, and responds with 2xx."""

    label: str
    url: str

    def problem(self) -> str:
        """Return an empty text: problems show only at delivery."""
        return ""

    def deliver(self, message: Message, within_s: float) -> str:
        """Send the message as the body of a POST request."""
        parts = urlsplit(self.url)
        secure = parts.scheme == "https"
        make = http.client.HTTPSConnection if secure else http.client.HTTPConnection
        connection = make(parts.hostname or "", parts.port, timeout=within_s)
        # The timeout of a connection applies to each read: a peer that sends a byte now and then would never time out.
        until = time.monotonic() + within_s
        ending = Timer(within_s, _cut, [connection])
        ending.daemon = True
        ending.start()
        headers = {"Content-Type": "application/json", "User-Agent": f"drivecomm/{__version__}"}
        if parts.username is not None:
            user = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
            headers["Authorization"] = f"Basic {base64.b64encode(user.encode()).decode()}"
        path = f"{parts.path or '/'}?{parts.query}" if parts.query else parts.path or "/"
        try:
            connection.request("POST", path, json.dumps(message).encode(), headers)
            status = connection.getresponse().status
        except TimeoutError:
            return f"no answer within {within_s:g} s"
        except (OSError, ValueError, http.client.HTTPException) as error:
            late = time.monotonic() >= until
            return f"no answer within {within_s:g} s" if late else _reason(error)
        finally:
            ending.cancel()
            connection.close()
        if 200 <= status < 300:
            return ""
        return f"it answered {status} {http.client.responses.get(status, '')}".rstrip()


def _cut(connection: http.client.HTTPConnection) -> None:
    with suppress(OSError, AttributeError):
        connection.sock.shutdown(SHUT_RDWR)


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandReceiver:
    """A program on this machine that takes the message on its standard input, and ends with exit status 0."""

    label: str
    argv: tuple[str, ...]

    def problem(self) -> str:
        """Return an error text if there is no such program."""
        from shutil import which

        return "" if which(self.argv[0]) else f"program {self.argv[0]} not found"

    def deliver(self, message: Message, within_s: float) -> str:
        """Run the command; kill it and its child processes if it takes too long."""
        return _run(self.argv, json.dumps(message), within_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class AppriseReceiver:
    """A URL of apprise, used in a separate process: apprise takes a second and 45 MB to load, and services may hang."""

    label: str
    url: str

    def problem(self) -> str:
        """Return the reason why apprise cannot use the URL, empty if it can."""
        return self._send({}, 30.0)

    def deliver(self, message: Message, within_s: float) -> str:
        """Deliver the message by apprise, which gets 20 s more to load and to wait for a mail server."""
        return self._send(message, within_s + 20 if within_s >= WITHIN_S else within_s)

    def _send(self, message: Message, within_s: float) -> str:
        argv = (sys.executable, "-m", "drivecomm.server.alarms.by_apprise")
        # Not as an argument, because every user of the machine can read those.
        return _run(argv, json.dumps({"url": self.url, "message": message}), within_s)


WITHIN_S = 10.0


def _run(argv: Sequence[str], given: str, within_s: float) -> str:
    # Files instead of pipes: a child process that keeps a pipe open would block the delivery.
    with tempfile.TemporaryFile() as stdin, tempfile.TemporaryFile() as stderr:
        stdin.write(given.encode())
        stdin.seek(0)
        try:
            process = subprocess.Popen(  # noqa: S603 - the command comes from the plant file
                argv, stdin=stdin, stdout=subprocess.DEVNULL, stderr=stderr, start_new_session=True
            )
        except (OSError, ValueError) as error:
            return _reason(error)
        try:
            status = process.wait(within_s)
        except subprocess.TimeoutExpired:
            _kill(process)
            return f"it did not end within {within_s:g} s and was killed"
        if status == 0:
            return ""
        stderr.seek(max(0, stderr.seek(0, os.SEEK_END) - 2000))
        said = stderr.read().decode(errors="replace").strip().splitlines()
        return f"it ended with exit status {status}" + (f": {said[-1][:200]}" if said else "")


def _kill(process: subprocess.Popen[bytes]) -> None:
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__


def check_entry(entry: str) -> None:
    """Raise UsageError for an invalid entry of deliver; secrets are not looked up."""
    if not entry.startswith("@"):
        _receiver(entry, "")
    elif not _SECRET.fullmatch(entry):
        raise UsageError(f"invalid name of a secret {entry!r}; write @ and letters, digits, - or _, such as @mail")


def receivers_of(entries: Sequence[str], environment: Mapping[str, str]) -> dict[str, AlarmReceiver]:
    """Return the receivers of deliver entries, by entry. Raises UsageError if a secret cannot be looked up."""
    return {
        entry: _receiver(_secret(entry, environment), entry) if entry.startswith("@") else _receiver(entry, "")
        for entry in entries
    }


def label_of(entry: str) -> str:
    """Return the name of a receiver, without any secret."""
    return entry if entry.startswith("@") else _receiver(entry, "").label


def key_of(entry: str) -> str:
    """Return a hash of an entry for use in files, because the entry may be a URL with a password."""
    return sha256(entry.encode()).hexdigest()[:16]


def _receiver(entry: str, label: str) -> AlarmReceiver:
    kind, colon, rest = entry.partition(":")
    if kind == "webhook":
        return WebhookReceiver(label=label or f"webhook {_host(rest, {'http', 'https'})}", url=rest)
    if kind == "command":
        try:
            argv = tuple(shlex.split(rest, posix=os.name != "nt"))
        except ValueError as error:
            raise UsageError(f"invalid command {rest!r}: {error}") from None
        if not argv:
            raise UsageError("the command is missing; write command:/usr/local/bin/page-me")
        return CommandReceiver(label=label or f"command {Path(argv[0]).name}", argv=argv)
    if not colon or not rest.startswith("//"):
        question = did_you_mean(kind, ["webhook", "command"])
        raise UsageError(
            f"unknown receiver{'' if label else f' {entry!r}'}; {question or 'write'} "
            "webhook:URL, command:PROGRAM, a URL of apprise such as mailto://..., or @NAME of a secret"
        )
    # The whole URL behind the scheme may be a token.
    return AppriseReceiver(label=label or kind, url=entry)


def _host(url: str, schemes: set[str]) -> str:
    try:
        parts = urlsplit(url)
        port = f":{parts.port}" if parts.port else ""
    except ValueError as error:
        raise UsageError(f"invalid URL of a webhook: {error}") from None
    if parts.scheme not in schemes or not parts.hostname or not re.fullmatch(r"[!-~]+", url):
        raise UsageError("invalid URL of a webhook; write webhook:https://example.com/hook, for example")
    return f"{parts.hostname}{port}"


def _secret(entry: str, environment: Mapping[str, str]) -> str:
    name = entry[1:]
    variable = _ENVIRONMENT + re.sub("-", "_", name).upper()
    if folder := environment.get("CREDENTIALS_DIRECTORY"):
        with suppress(FileNotFoundError):
            try:
                return (Path(folder) / name).read_text(encoding="utf-8").strip()
            except (PermissionError, IsADirectoryError, UnicodeDecodeError) as error:
                raise UsageError(f"the secret {entry} cannot be read from {folder}: {_reason(error)}") from None
    if found := environment.get(variable, "").strip():
        return found
    raise UsageError(
        f"there is no secret {entry}; put it into the file {name} of $CREDENTIALS_DIRECTORY, or into ${variable}"
    )
