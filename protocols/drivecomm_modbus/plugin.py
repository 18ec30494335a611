"""The plug-in for Modbus drives."""

from __future__ import annotations

from drivecomm.profiles import references_of
from drivecomm.protocol import LineFacts, LineSettings, Protocol, Timing, later
from drivecomm_modbus.addresses import address_space
from drivecomm_modbus.codec import intent, message_from, mismatch
from drivecomm_modbus.control import KEYS, control_of
from drivecomm_modbus.exchanges import ModbusOperations
from drivecomm_modbus.framings import blind_spots, codec_of
from drivecomm_modbus.memory import ModbusMemory
from drivecomm_modbus.options import ModbusOptions
from drivecomm_modbus.telegrams import ADDRESSES, BROADCAST, titled_forms

protocol = Protocol(
    name="modbus",
    title="Modbus RTU",
    package="drivecomm_modbus",
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=8, parity="N", stopbits=1),
        timing=Timing(
            reply_timeout_s=0.2,
            gap_s=0.050,
            turnaround_s=0.005,
            turnaround_characters=3.5,
            broadcast_pause_s=0.1,
            late_s=2.5,
            attempts=3,
        ),
    ),
    facts_source=(
        "9600 8N1: a default of drivecomm, what many drives are delivered with; 3.5 characters of silence between "
        "telegrams: the Modicon guide, Panasonic manual AFP7CPS4E p. 11-13; 5 ms besides: what programs for Danfoss "
        "FC 51 leave; 200 ms to answer: the longest response delay of Delta drives (VP3000 manual p. 249), whose "
        "models leave more; the gap, the pause after a broadcast, late replies and attempts are defaults of drivecomm"
    ),
    line_sources=dict.fromkeys(
        ("turnaround_characters", "silence_characters"), "the Modicon guide, Panasonic manual AFP7CPS4E p. 11-13"
    ),
    addresses=ADDRESSES,
    scan_addresses=ADDRESSES,
    default_model="danfoss-fc",
    broadcast_address=BROADCAST,
    options=ModbusOptions,
    codec=codec_of,
    blind_spots=blind_spots,
    addresses_of=lambda options: options.addresses,
    message=message_from,
    mismatch=mismatch,
    operations=ModbusOperations,
    memory=ModbusMemory,
    virtual=later("drivecomm_modbus.virtual:VirtualModbusDrive"),
    forms=titled_forms,
    parameter_examples=("16130", "0x2103", "40001", "i2103", "c65", "0x2100.low"),
    intent=intent,
    parameter_keys=frozenset({"word_order", "characters", "decimals"}),
    control_keys=KEYS,
    references=lambda _, model: references_of(model),
    refusals=lambda options, model: control_of(model, options).exceptions,
    silence_characters=3.5,
    address_space=address_space,
    schemes={"modbus-tcp": {"framing": "tcp"}},
)
