"""A Modbus series whose model has no commands: it has a status, values, and a control word that must not be written."""

GAUGE = """
format = 1
protocol = "modbus"
name = "gauge"
title = "Gauge drives"
source = "manual G-1 p. 3"
[quantities]
output_frequency = "0x3000"
acceleration_time = "0x0010"
[control]
reference_hz = "0x2001"
plain_write = "volatile"
[control.status]
running = ["0x2100", 0x0001, 0x0001]
fault = ["0x2100", 0x0008, 0x0008]
[[parameter]]
address = "0x2000"
name = "bus_control_word"
kind = "command"
type = "u16"
[[parameter]]
address = "0x2001"
name = "bus_frequency"
kind = "command"
type = "u16"
unit = "Hz"
factor = "0.01"
[[parameter]]
address = "0x2100"
name = "bus_status_word"
type = "u16"
access = "r"
[[parameter]]
address = "0x3000"
name = "actual_frequency"
type = "u16"
unit = "Hz"
factor = "0.01"
access = "r"
[[parameter]]
address = "0x0010"
name = "ramp_up_time"
type = "u16"
unit = "s"
factor = "0.1"
start = "5"
"""
