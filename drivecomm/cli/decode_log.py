"""Decoding of logs that other programs printed, for the decode command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.capture import read_log
from drivecomm.cli.output import counted, note, say, tell
from drivecomm.errors import TelegramError
from drivecomm.link import fields_text
from drivecomm.protocol import Framed, fields_of
from drivecomm.traffic.replay import telegrams_of_log

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from drivecomm.protocol import Codec
    from drivecomm.traffic.replay import Printed


def decode_log(path: Path, codecs: Mapping[str, Codec], *, as_json: bool) -> int:
    """Print the telegrams of a log, line by line. Returns exit code 4 if there are none."""
    read = read_log(path)
    for remark in read.remarks:
        tell(remark, as_json=as_json, remark=remark)
    found = telegrams_of_log(read.log, codecs)
    for each in found:
        _show(each, as_json=as_json)
    telegrams = sum(isinstance(find, Framed) for each in found for find in each.finds)
    if not as_json:
        say(f"{counted(telegrams, 'telegram')} in {counted(len(read.log), 'piece')} of {path}")
    if not telegrams:
        note("none of these bytes are a telegram of the protocols tried")
    return 0 if telegrams else TelegramError.exit_code


def _show(printed: Printed, *, as_json: bool) -> None:
    place = f"line {printed.line:<5} {printed.time_s:>9.3f} s  "
    about = {
        "line": printed.line,
        "time_s": round(printed.time_s, 6),
        "protocol": printed.protocol,
        "direction": printed.direction,
    }
    for find in printed.finds:
        if isinstance(find, Framed):
            text = f"{printed.protocol} {printed.direction}: {fields_text(find.message)}"
            tell(place + text, as_json=as_json, **about, valid=True, data=find.data, fields=fields_of(find.message))
        else:
            tell(f"{place}noise: {find.data.hex(' ').upper()}", as_json=as_json, **about, noise=find.data)
    if printed.refusal:
        text = f"{printed.data.hex(' ').upper()}: {printed.protocol} {printed.direction} {printed.refusal}"
        tell(place + text, as_json=as_json, **about, valid=False, data=printed.data, reason=printed.refusal)
