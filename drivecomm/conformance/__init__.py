"""Judging protocol packages: vectors and exchanges as data, and what every protocol must stand, whoever wrote it."""
