"""Values that were read, kept in files: CSV, which everything reads, and Parquet, which is small and quick."""

from drivecomm.value_log.reading_files import read_rows as read_rows
from drivecomm.value_log.rows import LogRow as LogRow
from drivecomm.value_log.writing import ValueLog as ValueLog
from drivecomm.value_log.writing import open_log as open_log
