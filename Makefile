# make demo and make test set everything up by themselves, in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# Tests run in a process for each core, which takes about 1 GB; one that has nothing left to do takes tests from another.
SPREAD := --numprocesses logical --maxprocesses 8 --dist worksteal

.PHONY: demo test test-fast lint format docs bench lock clean

demo: $(READY)
	$(BIN)/everplace demo --out demo

test: $(READY)
	$(BIN)/python -m pytest $(SPREAD)

test-fast: $(READY)
	$(BIN)/python -m pytest $(SPREAD) -m "not slow"

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(READY)
	$(BIN)/mkdocs build --strict

bench: $(READY)
	$(BIN)/python -m benchmarks

# Resolve the newest allowed versions and pin them.
lock:
	$(PYTHON) -m venv .lock-venv
	.lock-venv/bin/pip install --quiet torch==2.13.0
	.lock-venv/bin/pip install --quiet '.[dev]'
	.lock-venv/bin/pip freeze --exclude everplace --exclude pip --exclude setuptools | sed 's/+cpu$$//' > requirements-dev.lock
	rm -rf .lock-venv

$(READY): requirements-dev.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -r requirements-dev.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $(READY)

clean:
	rm -rf $(VENV) site build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
