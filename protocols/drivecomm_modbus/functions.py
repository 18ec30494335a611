"""Modbus functions that drives know, and the limits of the Modbus application protocol."""

from __future__ import annotations

READ_COILS, READ_INPUTS, READ_REGISTERS, READ_INPUT_REGISTERS = 0x01, 0x02, 0x03, 0x04
WRITE_COIL, WRITE_REGISTER = 0x05, 0x06
DIAGNOSTICS, EVENT_COUNTER = 0x08, 0x0B
WRITE_COILS, WRITE_REGISTERS = 0x0F, 0x10
REPORT_ID, READ_WRITE = 0x11, 0x17
IDENTIFICATION = 0x2B
READ_LONG, WRITE_LONG = 0x64, 0x65
"""Bonfiglioli's own functions for 32 bits in one telegram (Modbus/TCP manual ACU 10/13, p. 35, 36)."""

NAMES = {
    0x01: "read_coils", 0x02: "read_inputs", 0x03: "read_registers", 0x04: "read_input_registers", 0x05: "write_coil",
    0x06: "write_register", 0x08: "diagnostics", 0x0B: "event_counter", 0x0F: "write_coils", 0x10: "write_registers",
    0x11: "report_id", 0x17: "read_write_registers", 0x2B: "identification", 0x64: "read_long", 0x65: "write_long",
}  # fmt: skip

BROADCASTS = (WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS, WRITE_LONG)
"""Functions that may be sent to all drives, because they do not request data."""

READS = (READ_COILS, READ_INPUTS, READ_REGISTERS, READ_INPUT_REGISTERS, READ_LONG)

MOST_BITS_READ, MOST_REGISTERS_READ = 2000, 125
MOST_BITS_WRITTEN, MOST_REGISTERS_WRITTEN, MOST_WRITTEN_WITH_A_READ = 1968, 123, 121

UNKNOWN_FUNCTION, UNKNOWN_ADDRESS, BUSY = 1, 2, 6
"""Standard exceptions that determine the next request."""

EXCEPTIONS = {
    1: "unknown function", 2: "unknown address", 3: "invalid value", 4: "the drive failed to do it",
    5: "accepted, still working on it", 6: "busy",
}  # fmt: skip
"""Standard exception codes; the model of a series has those of its manufacturer."""
