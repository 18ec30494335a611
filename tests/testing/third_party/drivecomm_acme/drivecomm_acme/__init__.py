"""The Acme line protocol for drivecomm, from the Acme A10 line manual (invented, see README.md)."""

from drivecomm_acme.plugin import protocol as protocol
