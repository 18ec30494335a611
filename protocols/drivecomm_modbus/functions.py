"""The functions of Modbus that drives know, and the limits of the Modbus application protocol."""

from __future__ import annotations

READ_COILS, READ_INPUTS, READ_REGISTERS, READ_INPUT_REGISTERS = 0x01, 0x02, 0x03, 0x04
WRITE_COIL, WRITE_REGISTER = 0x05, 0x06
DIAGNOSTICS, EVENT_COUNTER = 0x08, 0x0B
WRITE_COILS, WRITE_REGISTERS = 0x0F, 0x10
REPORT_ID, READ_WRITE = 0x11, 0x17
IDENTIFICATION = 0x2B
READ_LONG, WRITE_LONG = 0x64, 0x65
"""Bonfiglioli's own: 32 bits in one telegram (Modbus/TCP manual ACU 10/13, p. 35, 36)."""

NAMES = {
    READ_COILS: "read_coils",
    READ_INPUTS: "read_inputs",
    READ_REGISTERS: "read_registers",
    READ_INPUT_REGISTERS: "read_input_registers",
    WRITE_COIL: "write_coil",
    WRITE_REGISTER: "write_register",
    DIAGNOSTICS: "diagnostics",
    EVENT_COUNTER: "event_counter",
    WRITE_COILS: "write_coils",
    WRITE_REGISTERS: "write_registers",
    REPORT_ID: "report_id",
    READ_WRITE: "read_write_registers",
    IDENTIFICATION: "identification",
    READ_LONG: "read_long",
    WRITE_LONG: "write_long",
}

BROADCASTS = (WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS, WRITE_LONG)
"""What can be said to all drives at once: nothing that asks for a reply."""

READS = (READ_COILS, READ_INPUTS, READ_REGISTERS, READ_INPUT_REGISTERS, READ_LONG)

MOST_BITS_READ, MOST_REGISTERS_READ = 2000, 125
MOST_BITS_WRITTEN, MOST_REGISTERS_WRITTEN, MOST_WRITTEN_WITH_A_READ = 1968, 123, 121

EXCEPTIONS = {
    1: "unknown function",
    2: "unknown address",
    3: "invalid value",
    4: "the drive failed to do it",
    5: "accepted, still working on it",
    6: "busy",
}
"""Codes of the standard; the model of a series has those of its maker."""
