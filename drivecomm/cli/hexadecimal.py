"""Bytes as people paste them from other programs, logs and source code."""

from __future__ import annotations

import re

from drivecomm.errors import UsageError

_DUMP_OFFSET = re.compile(r"^\s*(?:0x)?[0-9a-f]{4,8}(?::\s*|\s{2,})", re.IGNORECASE)
"""The offset at the start of a line of hexdump, xxd or a packet analyser."""

_GAP = re.compile(r"\s{2,}")
_BYTES = re.compile(r"(?:[0-9a-f]{2}\s?)+", re.IGNORECASE)
_WORDS_AROUND = re.compile(r"^<?Buffer\b|bytes\.fromhex|bytearray|bytes\b|\bb(?=['\"])", re.IGNORECASE)
_BYTE = re.compile(r"\\x|0x|\$|#|&h|16#", re.IGNORECASE)
_SEPARATORS = re.compile(r"[\s,;:|<>\[\](){}'\"_.-]+")


def bytes_of(text: str) -> bytes:
    r"""Return the bytes that a pasted text stands for. Raises UsageError if it is not hexadecimal.

    Understood: 0103, 01 03, 01-03, 01:03, 0x01,0x03, 0x1 0x3, \x01\x03, [01][03], <01><03>, 01h 03h, $01 $03,
    {0x01, 0x03}, and the lines of a hex dump with offsets and characters.
    """
    lines = [_without_offset_and_text(line) for line in text.splitlines()]
    words = [word for line in lines for word in _words(line)]
    try:
        if data := b"".join(_word(word) for word in words):
            return data
    except ValueError:
        pass
    raise UsageError(f"{text!r} is not hexadecimal; write bytes such as 04 41 or 0441")


def _without_offset_and_text(line: str) -> str:
    offset = _DUMP_OFFSET.match(line)
    if offset is None:
        return line
    line = line[offset.end() :]
    for gap in _GAP.finditer(line):
        shown, text = line[: gap.start()], line[gap.end() :]
        # A dump shows one character a byte, behind the last group of bytes.
        is_text = len(text) == len("".join(_words(shown))) // 2 and not _BYTES.fullmatch(text)
        if text.startswith("|") or is_text:
            return shown
    return line


def _words(line: str) -> list[str]:
    plain = _WORDS_AROUND.sub(" ", line)
    # Each prefix begins a byte of its own, so that 0x1 0x3 and \x01\x03 fall apart.
    return [word for word in _SEPARATORS.split(_BYTE.sub(" =", plain)) if word]


def _word(word: str) -> bytes:
    digits = word.removeprefix("=")
    if word.startswith("=") and len(digits) == 1:
        digits = f"0{digits}"
    if digits[-1:] in "hH" and len(digits) in (2, 3):
        digits = digits[:-1].zfill(2)
    return bytes.fromhex(digits)
