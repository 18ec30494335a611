from .csv_files import CsvLog as CsvLog, read_csv as read_csv
from .log_files import ValueLog as ValueLog, open_log as open_log, read_rows as read_rows
from .parquet_files import ParquetLog as ParquetLog, journal_of as journal_of, read_parquet as read_parquet
from .rows import BEGINNING as BEGINNING, COLUMNS as COLUMNS, LogRow as LogRow, row_of as row_of
