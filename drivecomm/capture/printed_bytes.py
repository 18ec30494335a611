"""Parsing of bytes as people copy them from other programs, logs and source code."""

from __future__ import annotations

import re

from drivecomm.errors import UsageError

_DUMP_OFFSET = re.compile(r"^\s*(?:0x)?[0-9a-f]{4,8}(?::\s*|\s{2,})", re.IGNORECASE)
"""Offset at the start of a line of hexdump, xxd or a packet analyser."""

_GAP = re.compile(r"\s{2,}")
_BYTES = re.compile(r"(?:[0-9a-f]{2}\s?)+", re.IGNORECASE)
_WORDS_AROUND = re.compile(r"^<?Buffer\b|bytes\.fromhex|bytearray|bytes\b|\bb(?=['\"])", re.IGNORECASE)
_DECLARATION = re.compile(r"^[\w\s:*]+(?:\[\s*\w*\s*\][\w\s]*)?\s*=\s*(?=[{\[])")
"""Text before the bytes in C and C#, as in `static const uint8_t frame[8] = {`."""

_COMMENT = re.compile(r"//.*|/\*.*?\*/")
_BYTE = re.compile(r"\\x|0x|\$|#|&h|16#", re.IGNORECASE)
_SEPARATORS = re.compile(r"[\s,;:|<>\[\](){}'\"_.-]+")
_DECIMAL = re.compile(
    r"\s*(?:bytes|bytearray)?\s*[\[({]*\s*\d{1,3}(?:(?:\s*[,;]\s*|[\s-]+)\d{1,3})+[\s,;]*[\])}]*\s*;?\s*"
)
_LITERAL = re.compile(r"""^\s*(?:bytes|bytearray)?\(?\s*[bB]?(['"])(.*\\.*)\1\s*\)?\s*;?\s*$""", re.DOTALL)
_ESCAPE = re.compile(r"\\(?:x([0-9a-fA-F]{2})|([0-7]{1,3})|(.))", re.DOTALL)
_SIGNS = {"n": "\n", "r": "\r", "t": "\t", "f": "\f", "v": "\v", "a": "\a", "b": "\b", "e": "\x1b"}


def bytes_of(text: str) -> bytes:
    r"""Return the bytes in a pasted text. Raises UsageError if it is not hexadecimal.

    Accepted: 0103, 01 03, 01-03, 01:03, 0x01,0x03, 0x1 0x3, \x01\x03, `[01][03]`, <01><03>, 01h 03h, $01 $03, {0x01,
    0x03}, arrays of C with their declaration, bytes([1, 3]) and b'\x01\x03' of Python, lists of decimal numbers that
    include one with three digits, and the lines of a hex dump with offsets and characters.
    """
    lines = [_without_offset_and_text(_COMMENT.sub("", line)) for line in text.splitlines()]
    words = [word for line in lines for word in _words(_DECLARATION.sub("", line))]
    try:
        if (literal := _LITERAL.match(text)) is not None:
            return unescaped(literal[2])
        if (numbers := _decimal(text)) is not None:
            return numbers
        if data := b"".join(_word(word) for word in words):
            return data
    except ValueError:
        pass
    raise UsageError(f"{text!r} is not hexadecimal; write bytes such as 04 41 or 0441")


def unescaped(text: str) -> bytes:
    r"""Return the bytes in a quoted C or Python text with escapes such as \x03, \3 and \n.

    Raises ValueError for a character that is not a byte.
    """
    shown = _ESCAPE.sub(
        lambda each: chr(int(each[1], 16) if each[1] else int(each[2], 8) & 0xFF) if each[3] is None else
        _SIGNS.get(each[3], each[3]),
        text,
    )  # fmt: skip
    return shown.encode("latin-1")


def _decimal(text: str) -> bytes | None:
    """Return the bytes in a list of decimal numbers, None if the numbers may be hexadecimal.

    A number of three digits cannot be a byte in hexadecimal, and `bytes([16, 3])` is Python; `10 20` could be either.
    """
    text = _DECLARATION.sub("", text)
    if not _DECIMAL.fullmatch(text):
        return None
    words = re.findall(r"\d+", text)
    numbers = [int(word) for word in words]
    alike = all(len(word) == 3 for word in words)
    certain = text.lstrip().startswith("byte") or (
        any(len(word) == 3 for word in words) and (alike or not any(word[0] == "0" and len(word) > 1 for word in words))
    )
    return bytes(numbers) if certain and max(numbers) <= 0xFF else None


def _without_offset_and_text(line: str) -> str:
    offset = _DUMP_OFFSET.match(line)
    if offset is None:
        return line
    line = line[offset.end() :]
    for gap in _GAP.finditer(line):
        shown, text = line[: gap.start()], line[gap.end() :]
        # A dump shows one character per byte after the last group of bytes.
        is_text = len(text) == len("".join(_words(shown))) // 2 and not _BYTES.fullmatch(text)
        if text.startswith("|") or is_text:
            return shown
    return line


def _words(line: str) -> list[str]:
    plain = _WORDS_AROUND.sub(" ", line)
    # Each prefix starts a new byte, so that 0x1 0x3 and \x01\x03 are split.
    return [word for word in _SEPARATORS.split(_BYTE.sub(" =", plain)) if word]


def _word(word: str) -> bytes:
    digits = word.removeprefix("=")
    if word.startswith("=") and len(digits) == 1:
        digits = f"0{digits}"
    if digits[-1:] in "hH" and len(digits) in (2, 3):
        digits = digits[:-1].zfill(2)
    return bytes.fromhex(digits)
