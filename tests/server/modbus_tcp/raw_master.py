"""A small Modbus TCP master that uses none of the door's code and sends any bytes."""

import socket
import struct
import time


class Refused(Exception):  # noqa: N818 - a reply, not a failure
    """A reply with an exception code."""

    def __init__(self, code):
        super().__init__(f"exception {code}")
        self.code = code


class Master:
    def __init__(self, port, unit=1, timeout=10, address="127.0.0.1"):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=timeout, source_address=(address, 0))
        self.unit = unit
        self._transaction = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self.socket.close()

    def frame(self, content, unit=None):
        self._transaction = (self._transaction + 1) % 65536
        unit = self.unit if unit is None else unit
        return struct.pack(">HHHB", self._transaction, 0, len(content) + 1, unit) + content

    def exchange(self, content, unit=None):
        """Send a request, given from its function code on; return the reply in the same form."""
        frame = self.frame(content, unit)
        self.socket.sendall(frame)
        head, answer = self.receive()
        assert head[:4] == frame[:4]
        assert head[6] == frame[6]
        if answer[0] & 0x80:
            assert answer[0] == content[0] | 0x80
            assert len(answer) == 2
            raise Refused(answer[1])
        assert answer[0] == content[0]
        return answer[1:]

    def receive(self):
        head = self._exactly(7)
        return head, self._exactly(int.from_bytes(head[4:6]) - 1)

    def _exactly(self, count):
        found = b""
        while len(found) < count:
            piece = self.socket.recv(count - len(found))
            if not piece:
                raise EOFError
            found += piece
        return found

    def read(self, address, count, function=4, unit=None):
        answer = self.exchange(struct.pack(">BHH", function, address, count), unit)
        assert answer[0] == 2 * count == len(answer) - 1
        return list(struct.unpack(f">{count}H", answer[1:]))

    def float(self, address, **further):
        return struct.unpack(">f", struct.pack(">HH", *self.read(address, 2, **further)))[0]

    def write(self, address, *words, unit=None):
        answer = self.exchange(
            struct.pack(f">BHHB{len(words)}H", 16, address, len(words), 2 * len(words), *words), unit
        )
        assert struct.unpack(">HH", answer) == (address, len(words))

    def write_one(self, address, word, unit=None):
        asked = struct.pack(">BHH", 6, address, word)
        assert self.exchange(asked, unit) == asked[1:]

    def write_and_read(self, write_at, words, read_at, count):
        content = struct.pack(f">BHHHHB{len(words)}H", 23, read_at, count, write_at, len(words), 2 * len(words), *words)
        answer = self.exchange(content)
        return list(struct.unpack(f">{count}H", answer[1:]))

    def is_cut_off(self, seconds=5.0):
        """Return whether the door closes the connection within this number of seconds."""
        self.socket.settimeout(seconds)
        try:
            while self.socket.recv(65536):
                pass
        except ConnectionError:
            return True
        except TimeoutError:
            return False
        return True


def float_words(number):
    return struct.unpack(">HH", struct.pack(">f", number))


def until(condition, seconds=10.0):
    """Wait until a condition is true, and return its value."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "the condition did not become true"
        time.sleep(0.01)
    return found
