"""Modules that commands load, imported once by the process from which commands are forked.

It loads only modules and the commands themselves; each command still looks for protocols.
"""

import asyncio
import contextlib
import gc
import io

import platformdirs
import serial.rfc2217

import drivecomm_danfoss_fc.plugin
import drivecomm_fuji.plugin
import drivecomm_vabus.plugin
import drivecomm_vlt3500.plugin
from drivecomm.cli import main
from drivecomm.testing import run_conformance

__all__ = ["asyncio", "drivecomm_danfoss_fc", "drivecomm_fuji", "drivecomm_vabus", "drivecomm_vlt3500"]
__all__ += ["platformdirs", "run_conformance", "serial"]

with contextlib.redirect_stdout(io.StringIO()):
    for command in ("decode", "encode", "scan", "read", "simulate", "conformance", "protocols"):
        main([command, "--help"])
gc.freeze()
