"""Register files of other programs, each with the facts to import, the facts to leave out, and a drive to check it.

Register numbers are those of telegrams; they were counted by hand, not by the code under test.
"""

from dataclasses import dataclass, field
from pathlib import Path

FILES = Path(__file__).parent / "files"


@dataclass(frozen=True)
class Case:
    """Expected result of one import.

    registers: words of the drive, numbered as in a telegram. reads: value and unit by name. left: place and reason of
    each fact that is left out.
    """

    registers: dict[str, int]
    reads: dict[str, tuple[str, str]]
    left: list[tuple[str, str]]
    options: dict[str, object] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    drive: int | None = None
    written: tuple[str, ...] = ()


CASES = {
    "lueftung.csv": Case(
        {"102": 5012, "103": 123, "104": 0xFFCE, "200": 1, "201": 1, "i10": 0xFFF6, "300": 1, "301": 2},
        {
            "ausgangsfrequenz": ("50.12", "Hz"),
            "ausgangsstrom": ("12.3", "A"),
            "drehmoment": ("-5.0", "%"),
            "betriebsart": ("1", ""),
            "betriebsart_text": ("1", ""),
            "kuhlkorper_temperatur": ("-1.0", "degC"),
            "energie": ("6553.8", "kWh"),
        },
        [("line 3", "not understood"), ("line 12", "width and sign")],
        assumed=("Modicon", "high word"),
        written=("steuerwort",),
    ),
    "pump-list.csv": Case(
        {"8451": 2500, "8452": 31, "8449": 3, "8454": 2300, "8464": 0xFFFF, "8465": 0xFA24},
        {
            "output_frequency": ("25.00", "Hz"),
            "output_current": ("3.1", "A"),
            "run_state_bit_0": ("3", ""),
            "output_voltage": ("230.0", "V"),
            "speed_feedback": ("-1500", "rpm"),
        },
        [
            ("line 1", "not understood"),
            ("line 1", "another count"),
            ("line 4", "no offset"),
            ("line 9", "width and sign"),
        ],
        assumed=("hexadecimal", "INT is a signed number"),
        written=("command",),
    ),
    "nasos.csv": Case(
        {"i0": 4950, "i1": 77, "i2": 0xFFFF, "3": 9},
        {
            "vyhodnaja_chastota": ("49.50", "Hz"),
            "vyhodnoj_tok": ("7.7", "A"),
            "temperatura_radiatora": ("-0.1", "degC"),
            "kod_avarii": ("9", ""),
        },
        [("line 6", "not an exact factor")],
        assumed=("counted from 0",),
    ),
    "wb-fan-drive.json": Case(
        {"3201": 4000, "i3203": 25, "3203": 1450, "3204": 8, "c17": 1, "3212": 15, "1210": 1},
        {
            "output_frequency": ("40.00", "Hz"),
            "output_current": ("2.5", "A"),
            "motor_speed": (str(1450 + (8 << 16)), "rpm"),
            "fault": ("1", ""),
            "run": ("1", ""),
            "pressure": ("1.5", "bar"),
            "stop_mode": ("1", ""),
        },
        [
            ("device.setup[0]", "never sent"),
            ("device.channels[4]", "no offset"),
            ("device.channels[5]", "not a type"),
            ("device.channels[7].error_value", "read all the same"),
        ],
        assumed=("only read",),
    ),
    "fluidnc.yaml": Case(
        {"776": 1000, "777": 4000, "i4107": 2000},
        {
            "lowest_spindle_speed": ("6000", "rpm"),
            "highest_spindle_speed": ("24000", "rpm"),
            "spindle_speed": ("12000", "rpm"),
        },
        [("cw_cmd", "never sent"), ("off_cmd", "never sent"), ("set_rpm_cmd", "never sent")],
        {"baudrate": 19200, "bytesize": 8, "parity": "E", "stopbits": 1},
        written=("command_register", "command_register_0x1001"),
    ),
    "grblhal.txt": Case(
        {"8451": 20000},
        {"spindle_speed": ("12000.0", "rpm")},
        [("$462", "never written"), ("$463", "never written")]
        + [(f"${each}", "never sent") for each in (465, 466, 467, 468, 469)]
        + [("$461", "other spindles")],
        assumed=("in rpm",),
        written=("command_register", "frequency_command_register"),
    ),
    "router-spindle.ini": Case(
        {"12288": 3000, "12290": 3112},
        {"spindle_speed": ("18000", "rpm"), "dc_link_voltage_value": ("311.2", "")},
        [
            ("[Control]", "never written"),
            ("[Control] runforwardvalue", "never sent"),
            ("[Control] stopvalue", "never sent"),
            ("[SpindleRpmIn]", "never written"),
            ("[Torque]", "exactly"),
            ("[Fault]", "which bit"),
        ],
        {"baudrate": 38400, "parity": "E"},
        written=("command_register", "speed_command_register"),
    ),
    "home-assistant.yaml": Case(
        {"8451": 3333, "i8460": 0xFFF6, "8470": 7, "8471": 1, "d12": 1},
        {
            "output_frequency": ("33.33", "Hz"),
            "torque_value": ("-1.0", "%"),
            "running_hours": ("65543", "h"),
            "drive_ready": ("1", ""),
        },
        [
            ("modbus[0].sensors[1].nan_value", "read all the same"),
            ("modbus[0].sensors[3]", "no offset"),
            ("modbus[0].sensors[4]", "not a type"),
            ("modbus[0].switches[0]", "never done"),
            ("modbus[1]", "another line"),
        ],
        {"baudrate": 19200, "bytesize": 8, "parity": "E", "stopbits": 1},
        drive=5,
        written=("drive_run",),
    ),
    "telegraf.conf": Case(
        {"8451": 5000, "8455": 0xFA24, "8456": 0xFFFF, "8460": 0x42C8, "8461": 0, "d3": 1},
        {
            "output_frequency_value": ("50.00", ""),
            "motor_speed": ("-1500", "rpm"),
            "energy": ("100", "kWh"),
            "ready": ("1", ""),
        },
        [
            ("inputs.modbus[0].holding_registers[3]", "an order"),
            ("inputs.modbus[0].holding_registers[4]", "not consecutive registers"),
        ],
        {"baudrate": 9600, "bytesize": 8, "parity": "N", "stopbits": 2},
    ),
    "telegraf-requests.toml": Case(
        {"i10": 123, "i12": 0x40B0, "i13": 0, "i18": 4},
        {"output_current": ("12.3", "A"), "power": ("5.5", "kW"), "state": ("1", "")},
        [("inputs.modbus[0].request[0].fields[2]", "not a type")],
    ),
}
