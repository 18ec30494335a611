"""A small pcapng reader, written from the specification alone, to check the files that drivecomm writes."""

import struct


def blocks_of(content):
    """Yield byte order, type and body of each block; both lengths of a block must agree, and blocks cover all bytes."""
    place, order = 0, None
    while place < len(content):
        if content[place : place + 4] == b"\x0a\x0d\x0d\x0a":
            order = {b"\x1a\x2b\x3c\x4d": ">", b"\x4d\x3c\x2b\x1a": "<"}[content[place + 8 : place + 12]]
        kind, length = struct.unpack(order + "II", content[place : place + 8])
        assert length % 4 == 0
        assert struct.unpack(order + "I", content[place + length - 4 : place + length]) == (length,)
        yield order, kind, content[place + 8 : place + length - 4]
        place += length
    assert place == len(content)


def options_of(order, data):
    """Return options by code; the list must end with opt_endofopt and nothing after it."""
    found, place = {}, 0
    while True:
        code, length = struct.unpack(order + "HH", data[place : place + 4])
        place += 4
        if code == 0:
            assert length == 0
            assert place == len(data)
            return found
        assert code not in found
        found[code] = data[place : place + length]
        padded = -(-length // 4) * 4
        assert not any(data[place + length : place + padded])
        place += padded


def packets_of(content):
    """Return section options, interfaces as (link type, options), and packets as (interface, ns, data, options)."""
    section, interfaces, packets = None, [], []
    for order, kind, body in blocks_of(content):
        if kind == 0x0A0D0D0A:
            assert section is None
            _, major, minor, length = struct.unpack(order + "IHHq", body[:16])
            assert (major, minor, length) == (1, 0, -1)
            section = options_of(order, body[16:])
        elif kind == 1:
            link_type, reserved, _ = struct.unpack(order + "HHI", body[:8])
            assert reserved == 0
            interfaces.append((link_type, options_of(order, body[8:])))
        else:
            assert kind == 6
            number, high, low, captured, original = struct.unpack(order + "IIIII", body[:20])
            assert captured == original
            assert interfaces[number][1][9] == b"\x09"
            data, rest = body[20 : 20 + captured], body[20 + -(-captured // 4) * 4 :]
            packets.append((number, (high << 32) + low, data, options_of(order, rest)))
    return section, interfaces, packets
