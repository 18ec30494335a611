# Everything runs in a virtual environment of its own; `make demo` and `make test` need nothing but Python 3.11 or newer.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

# Twice as many processes as there are cores: many tests wait for a port or a process.
WORKERS ?= $(shell $(PYTHON) -c "import os; print(os.cpu_count() * 2)")
# What starts pytest; `.ci/run` has one that runs again alone what has failed.
RUNNER ?= -m pytest
# What is skipped says why.
PYTEST := $(BIN)/python $(RUNNER) -rs --numprocesses $(WORKERS) --dist worksteal

# Tests start many processes, which would compile every module again where the environment forbids to keep it.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-rest test-all coverage check docs bench bench-quick fuzz mutants mutants-any clean

demo: $(VENV)/installed-server
	$(BIN)/drivecomm demo

# What answers quickly, what it leaves out, and both in one run.
test: $(VENV)/installed-test
	$(PYTEST) -m "not soak"

test-rest: $(VENV)/installed-test
	$(PYTEST) -m soak

test-all: $(VENV)/installed-test
	$(PYTEST)

coverage: $(VENV)/installed-test
	$(BIN)/python -m pytest --cov --cov-report=term

check: $(VENV)/installed-check
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	PYTHONPATH=protocols $(BIN)/lint-imports

docs: $(VENV)/installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

bench: $(VENV)/installed-bench
	$(BIN)/python benchmarks/run.py

# In five minutes; writes no file.
bench-quick: $(VENV)/installed-bench
	$(BIN)/python benchmarks/run.py --quick

fuzz: $(VENV)/installed-fuzz
	$(BIN)/python fuzz/run.py

mutants: $(VENV)/installed-test
	$(BIN)/python mutants/run.py

# Any mistakes, in one room: make mutants-any ROOM=line
mutants-any: $(VENV)/installed-mutants
	$(BIN)/python mutants/any.py $(ROOM)

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) --editable .
	touch $@

$(VENV)/installed-%: $(VENV)/installed
	$(PIP) --editable ".[$*]"
	touch $@

clean:
	rm -rf $(VENV) .cache site build dist
