"""Small VABus master in plain pyserial with optional mistakes: vabus_master.py PORT TASK [WORDS...].

The environment variable MISTAKE selects the mistakes; without it the master is correct.
"""

import os
import sys
import time

import serial

MISTAKES = set(os.environ.get("MISTAKE", "").split())
TIMEOUT_S = 0.55
ATTEMPTS = 3
DRAIN_S = 0.1
ADDRESS = 1
ERRORS, CONTROL, STATE, REMOTE = 11, 410, 411, 412
RUN, HALT = (0x0006, 0x0007, 0x000F), 0x0006


class Refused(Exception):
    pass


class NoReply(Exception):
    pass


def digits(parameter):
    return 4 if parameter in (ERRORS, CONTROL, STATE, REMOTE) else 8


def bcc(data):
    check = 0
    for each in data:
        check ^= each
    return check


class Master:
    def __init__(self, port):
        settings = {"baudrate": 19200, "bytesize": 7, "parity": "E"}
        if "settings" in MISTAKES:
            settings["baudrate"] = 9600
        self.port = serial.serial_for_url(port, timeout=TIMEOUT_S, **settings)
        self.rested_at = 0.0

    def pause(self):
        if "pause" not in MISTAKES:
            time.sleep(0.004)

    def drain(self):
        """Read until no more bytes arrive."""
        if "late" in MISTAKES:
            time.sleep(0.2)
        if MISTAKES & {"flush", "late"}:
            return
        self.port.timeout = DRAIN_S
        while self.port.read(64):
            pass
        self.port.timeout = TIMEOUT_S

    def attempt(self, data, length, ending):
        if not MISTAKES & {"flush", "late"}:
            self.port.reset_input_buffer()
        self.pause()
        self.port.write(data)
        return self.port.read_until(ending, length) if ending else self.port.read(length)

    def ask(self, parameter, dataset=0):
        data = bytes([4, 0x40 + ADDRESS]) + b"0%d%03d\x05" % (dataset, parameter)
        for _ in range(1 if "attempts" in MISTAKES else ATTEMPTS):
            reply = self.attempt(data, 2, None)
            if len(reply) == 2 and reply[1] == 2:
                reply += self.port.read(9 + digits(parameter))
            value = self.value_of(reply, parameter, dataset)
            if value is not None:
                return value
            self.drain()
        raise NoReply("no reply")

    def value_of(self, reply, parameter, dataset):
        node = bytes([0x40 + ADDRESS])
        if reply == node + b"\x15":
            if "error" in MISTAKES:
                return 0
            if "refused" in MISTAKES:
                return None
            raise Refused("refused")
        size = digits(parameter)
        if len(reply) < 11 + size and ("cut" not in MISTAKES or len(reply) < 10):
            return None
        if "address" not in MISTAKES and reply[:1] != node:
            return None
        whole = len(reply) == 11 + size
        if "checksum" not in MISTAKES and whole and bcc(reply[2:-1]) != reply[-1]:
            return None
        if "parameter" not in MISTAKES and reply[2:7] != b"0%d%03d" % (dataset, parameter):
            return None
        try:
            return int(reply[9 : 9 + size].rstrip(b"\x03"), 16)
        except ValueError:
            return None

    def select(self, parameter, value, dataset=0, attempts=ATTEMPTS):
        size = digits(parameter)
        body = b"0%d%03d%02d%0*X\x03" % (dataset, parameter, size, size, value & 0xFFFFFFFF)
        data = bytes([4, 0x40 + ADDRESS, 2]) + body + bytes([bcc(body)])
        for _ in range(attempts):
            reply = self.attempt(data, 2, None)
            if reply == bytes([0x40 + ADDRESS, 6]):
                return
            if reply == bytes([0x40 + ADDRESS, 0x15]):
                if "error" in MISTAKES:
                    return
                if "refused" in MISTAKES:
                    continue
                code = self.ask(ERRORS) if "register" not in MISTAKES else 0
                raise Refused(f"refused with code {code}")
            self.drain()
        raise NoReply("no reply")

    def unlock(self):
        if "register" not in MISTAKES:
            self.ask(ERRORS)


def start(master):
    master.unlock()
    if master.ask(REMOTE) != 1:
        master.select(REMOTE, 1)
    for word in RUN[:-1]:
        master.select(CONTROL, word)
    master.select(CONTROL, RUN[-1], attempts=ATTEMPTS if "start" in MISTAKES else 1)


def stop(master):
    if "ask_first" in MISTAKES:
        master.ask(STATE)
    for _ in range(1 if "stop" in MISTAKES else ATTEMPTS):
        try:
            master.select(CONTROL, HALT, attempts=1)
        except Refused:
            master.unlock()
        except NoReply:
            continue
        else:
            return
    raise NoReply("no reply")


def write(master, parameter, value):
    raw = round(float(value) * 100)
    if "clamp" in MISTAKES:
        raw = min(raw, 99999 // 2)
    if "wrap" in MISTAKES:
        raw &= 0xFFFF
    master.unlock()
    for _ in range(30 if "eeprom" in MISTAKES else 1):
        try:
            master.select(int(parameter), raw)
        except NoReply:
            if "confirmed" not in MISTAKES:
                raise
    print("written")


def show(master, *parameters):
    missing = False
    for parameter in parameters:
        try:
            raw = master.ask(int(parameter)) * (10 if "scale" in MISTAKES else 1)
        except NoReply:
            missing = True
        else:
            print(f"{raw / 100:.2f} Hz" if len(parameters) == 1 else f"{parameter}: {raw / 100:.2f} Hz", flush=True)
    if missing:
        raise NoReply("no reply")


def poll(master, parameter):
    while True:
        try:
            show(master, parameter)
        except (NoReply, Refused) as error:
            print(f"error: {error}", file=sys.stderr, flush=True)
            if "gives_up" in MISTAKES:
                raise
        time.sleep(0 if "pause" in MISTAKES else 0.1)


def keep_running(master):
    try:
        start(master)
    except (NoReply, Refused) as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
    while True:
        try:
            state = master.ask(STATE)
            print(f"state {state}", flush=True)
            if "restarts" in MISTAKES and state & 0x6F != 0x27:
                start(master)
        except (NoReply, Refused) as error:
            print(f"error: {error}", file=sys.stderr, flush=True)
        time.sleep(0 if "pause" in MISTAKES else 0.1)


def main(port, task, *words):
    master = Master(port)
    tasks = {"read": show, "write": write, "poll": poll, "keep": keep_running, "start": start, "stop": stop}
    try:
        if task == "reset":
            master.unlock()
            master.select(CONTROL, 0)
            master.select(CONTROL, 0x80)
        else:
            tasks[task](master, *words)
    except (NoReply, Refused) as error:
        if "silent" not in MISTAKES:
            sys.exit(f"error: {error}")


if __name__ == "__main__":
    main(*sys.argv[1:])
