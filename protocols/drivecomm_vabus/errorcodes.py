"""The error register, parameter 11, with the reason of a NAK; errors.toml has all codes and their source."""

from __future__ import annotations

ERROR_REGISTER = 11

VALUE_NOT_PERMITTED = 1
DATASET_NOT_PERMITTED = 2
NOT_READABLE = 3
NOT_WRITABLE = 4
NOT_WHILE_RUNNING = 8
DATASETS_DIFFER = 9
UNKNOWN_PARAMETER = 11
CHECKSUM_ERROR = 12
SYNTAX_ERROR = 13
WRONG_LENGTH = 14
SYSTEM_BUS_UNREACHABLE = 20

LINE_FAULTS = frozenset([CHECKSUM_ERROR, SYNTAX_ERROR])
"""Codes that a disturbed line can cause, for which one repetition makes sense."""
