"""Automatic backups of a server: parameter sets of its drives, read while their lines are idle.

`Backups` decides which drive is due and reads it; `Shelf` stores the files, one folder a drive; `DriftWatch` compares
the sets with the baselines, and knows the differences.
"""
