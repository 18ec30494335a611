"""Mutation of inputs. All randomness comes from the given Random, so a seed repeats a run."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence
    from random import Random

LONGEST = 4096
"""Limit for the length of an input: eight times the longest telegram, so that growing buffers show."""

# Characters that begin and end telegrams of serial protocols, digits, and the ends of ranges.
_TELLING = b"\x00\x01\x02\x03\x04\x05\x06\x0a\x0d\x15\x17\x1b 09<>?@AFPUZ[]af~\x7f\x80\xfe\xff"

_TOML_VALUES = (
    *("0", "-1", "1", "1.5", "nan", "inf", "-inf", "1e308", "true", "false", '""', '"\\u0000"', '"x"', '"-"', "'\"'"),
    *("[]", "{}", "[[]]", "[{}]", '[""]', "{ a = 1 }", '{ "" = "" }', "1979-05-27", "07:32:00", "1979-05-27T07:32:00Z"),
    *("9223372036854775808", "0x7fffffffffffffffffffff", "1" + "0" * 400, "9" * 5000, "[" * 1500, "[" * 40 + "]" * 40),
    *('"' + "9" * 30 + '"', '"vabus:1"', '"fuji:31"', '"danfoss-fc:0"', '"²"', '"٣"', '"\\uffff"', '["481", 1]'),
)
_JSON_VALUES = (
    *("0", "-1", "1", "1.5", "NaN", "Infinity", "-Infinity", "1e400", "true", "false", "null", '""', '"x"', '"0"'),
    *("[]", "{}", "[[]]", "[{}]", '[""]', '{"": ""}', '"\\ud800"', '"\\u0000"', '"00"', "3e9", "2999999999.9999"),
    *("9" * 400, "9" * 5000, "[" * 2000, '"²"', '"٣ ٣"', '"0001-01-01T00:00:00+23:59"', '"9999-12-31T23:59:59-23:59"'),
    *('{"baudrate": 1e9}', '{"baudrate": true}', '{"bytesize": []}', '{"stopbits": {}}', '{"parity": []}'),
)
_TOML_VALUE = re.compile(rb'(?<== )(?:"[^"\n]*"|[\w.+-]+|\[[^\]\n]*\]|\{[^}\n]*\})')
_JSON_VALUE = re.compile(rb'(?<=: )(?:"[^"\n]*"|[\w.+-]+|\[[^\]\n]*\]|\{[^}\n]*\})')


class Mutator(Protocol):
    """Mutator of inputs. others: all inputs that a run began with."""

    def __call__(self, random: Random, data: bytes, others: Sequence[bytes]) -> bytes:
        """Return a new input of at most `LONGEST` bytes, or of twice that for text."""
        ...


def mutate_bytes(random: Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Change one to four places: flip bits, replace characters, and remove, double, insert or copy pieces."""
    changed = bytearray(data)
    for _ in range(1 + int(random.random() * 4)):
        size = len(changed)
        place = int(random.random() * (size + 1))
        way = int(random.random() * 8)
        if way == 0 and place < size:
            changed[place] ^= 1 << int(random.random() * 8)
        elif way == 1 and place < size:
            changed[place] = _TELLING[int(random.random() * len(_TELLING))]
        elif way == 2 and place < size:
            changed[place] = int(random.random() * 256)
        elif way == 3:
            changed[place:place] = _some(random)
        elif way == 4:
            del changed[place : place + 1 + int(random.random() * 6)]
        elif way == 5:
            other = others[int(random.random() * len(others))]
            start = int(random.random() * (len(other) + 1))
            changed[place:] = other[start:]
        elif way == 6:
            piece = changed[place : place + 1 + int(random.random() * 8)]
            changed[place:place] = piece * (1 if random.random() < 0.99 else 300)
        elif place + 1 < size:
            changed[place], changed[place + 1] = changed[place + 1], changed[place]
    return bytes(changed[:LONGEST])


def _some(random: Random) -> bytes:
    if random.random() < 0.5:
        return random.randbytes(1 + int(random.random() * 4))
    return bytes(random.choices(_TELLING, k=1 + int(random.random() * 4)))


def mutate_toml(random: Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Change one to three values, keys or lines of a TOML text; sometimes its bytes."""
    return _mutate_text(random, data, others, _TOML_VALUE, _TOML_VALUES)


def mutate_json(random: Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Change one to three values, keys or lines of JSON objects; sometimes their bytes."""
    return _mutate_text(random, data, others, _JSON_VALUE, _JSON_VALUES)


def _mutate_text(
    random: Random, data: bytes, others: Sequence[bytes], pattern: re.Pattern[bytes], values: Sequence[str]
) -> bytes:
    for _ in range(1 + int(random.random() * 3)):
        way = random.random()
        if way < 0.6 and (places := [found.span() for found in pattern.finditer(data)]):
            start, end = random.choice(places)
            if random.random() < 0.7:
                data = data[:start] + random.choice(values).encode() + data[end:]
            elif taken := pattern.findall(random.choice(others)):
                data = data[:start] + random.choice(taken) + data[end:]
        elif way < 0.85:
            lines = data.split(b"\n")
            place = random.randrange(len(lines))
            if random.random() < 0.5:
                del lines[place]
            else:
                lines.insert(place, random.choice(random.choice((data, *others[:50])).split(b"\n")))
            data = b"\n".join(lines)
        else:
            data = mutate_bytes(random, data, others)
    return data[: 2 * LONGEST]
