"""The documentation page about the central record: its queries run, and it lists every existing column."""

import re
from pathlib import Path

import psycopg
import pytest
from mosquitto import mosquitto, needs_mosquitto
from played_plants import played_plants
from postgres import needs_postgres, postgres
from recorders import COUNTS, recording, until

from drivecomm.server.record import TABLES

PAGE = (Path(__file__).parents[3] / "docs/how-to/centre.md").read_text(encoding="utf-8")
QUERIES = re.findall(r'```sql title="([^"]+)"\n(.*?)```', PAGE, re.DOTALL)


@needs_mosquitto
@needs_postgres
@pytest.mark.soak
def test_queries_of_the_page_run_on_a_record(tmp_path):
    with (
        mosquitto(tmp_path / "broker") as broker,
        postgres() as database,
        recording(broker.url, database.url),
        played_plants(broker.url) as played,
    ):
        until(lambda: database.all("SELECT to_regclass('drivecomm.record')") != [(None,)])

        def recorded():
            played.publish()
            return database.all(COUNTS)[0][0] > 20

        until(recorded)
        answers = {}
        with psycopg.connect(database.url, autocommit=True) as connection:
            for title, query in QUERIES:
                cursor = connection.execute(query)
                answers[title] = cursor.fetchall() if cursor.description else None
    assert len(answers) == len(QUERIES) == 7
    trend = answers["a trend"]
    assert trend
    assert all(mean > 0 for _, mean in trend)
    assert len(answers["the latest value of every drive"]) == 6
    assert len(answers["hours with good values, by drive"]) == 6
    assert [row[0] for row in answers["what runs where"]] == ["plant 0", "plant 1", "plant 2"]


@pytest.mark.parametrize("table", TABLES)
def test_page_describes_each_column(table):
    rows = [line for line in PAGE.splitlines() if line.startswith(f"| `{table}.")]
    told = {name for row in rows for name in re.findall(r"`(?:\w+)?\.(\w+)`", row.split("|")[1])}
    assert told == set(TABLES[table].columns)
