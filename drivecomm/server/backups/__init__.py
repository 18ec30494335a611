"""Backups that a server makes by itself: parameter sets of its drives, read when nobody else wants the line.

`Backups` decides which drive is due and reads it; `Shelf` keeps the files, one folder a drive; `DriftWatch` compares
what was read with the baselines, and knows what differs.
"""
