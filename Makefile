# On a fresh machine: `make demo` or `make test`. Needs Python >= 3.11 with its venv module, nothing else.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := demo-output
BENCH := bench-output
PAGES := docs-output
WORKERS ?= 2
ARGS ?=

# As pip does for whatever it copies; else every run would do it anew where PYTHONDONTWRITEBYTECODE is set: 0.2 s.
BYTECODE := $(BIN)/python -m compileall -q graph frontends iceg

export PIP_DISABLE_PIP_VERSION_CHECK := 1
export MPLBACKEND ?= Agg
export ICEG_DATA ?= $(abspath ../shared/data)

.PHONY: help demo bench docs test lint types imports browser pytest pytest-bounds pytest-python machines fuzz hostile package format clean
.DEFAULT_GOAL := help

help:
	@echo "make demo    run the main job on the embedded log, result in $(DEMO)/"
	@echo "make test    lint, types, import contract and tests"
	@echo "make docs    these pages and the reference as a site, in $(PAGES)/; a warning is an error"
	@echo "make bench   accuracy and speed on the real logs (ICEG_DATA), or ARGS=FILE.toml; result in $(BENCH)/"
	@echo "make machines  whether every kind of processor finds the same; ARGS='LOG ... --python PATH ...'"
	@echo "make package wheel and sdist in dist/, checked, installed elsewhere and run there"
	@echo "make clean   remove the environment and all caches"

demo: $(VENV)/installed.stamp
	$(BIN)/iceg demo -o $(DEMO) --overwrite

bench: $(VENV)/installed-dev.stamp
	$(BIN)/iceg bench -o $(BENCH) $(ARGS)

# Every check runs even when an earlier one fails; the whole fails if any did.
test: $(VENV)/installed-dev.stamp
	@$(MAKE) --no-print-directory --keep-going -j1 lint types imports docs pytest

# Links within the pages are checked, those to elsewhere are not followed. Notebooks are executed and must hold.
docs: $(VENV)/installed-dev.stamp
	$(BIN)/sphinx-build -q -W --keep-going -d $(VENV)/docs-cache -b html docs $(PAGES)

lint: $(VENV)/installed-dev.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: $(VENV)/installed-dev.stamp
	$(BIN)/mypy

imports: $(VENV)/installed-dev.stamp
	$(BIN)/lint-imports

# A Chromium for the tests of the report's page: one that is there, else Debian's, else one that a package ships.
browser: $(VENV)/installed-dev.stamp
	@$(BIN)/python -m tests.browser

pytest: $(VENV)/installed-dev.stamp browser
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal $(ARGS)

pytest-bounds: $(VENV)/installed-dev.stamp
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(CURDIR)/$(VENV)/numba-bounds $(BIN)/python -m pytest -n $(WORKERS) $(ARGS)

pytest-python: $(VENV)/installed-dev.stamp
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n $(WORKERS) --timeout 3600 $(ARGS)

machines: $(VENV)/installed-dev.stamp
	$(BIN)/python tests/machines.py $(ARGS)

# ARGS="--minutes 10" or ARGS="--lines 1000000", --seed N; what it finds is kept in tests/fuzz_corpus/.
fuzz: $(VENV)/installed-dev.stamp
	$(BIN)/python -m tests.fuzz $(ARGS)

# Each hostile file in a process of its own, with its memory and time; ARGS="plan PNG" for a few.
hostile: $(VENV)/installed-dev.stamp
	$(BIN)/python -m tests.fuzz.hostile $(ARGS)

# ARGS="--python PATH ..." for the interpreters that the wheel is tried with.
package: $(VENV)/installed-dev.stamp
	$(BIN)/python tests/package.py $(ARGS)

format: $(VENV)/installed-dev.stamp
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) else \
	  f"Python 3.11 or newer is needed, {sys.executable} is {v[0]}.{v[1]}: make PYTHON=/path/to/python3.11 ...")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "Installing into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet -c constraints.txt -e .
	@$(BYTECODE)
	@touch $@

$(VENV)/installed-dev.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "Installing into $(VENV), with the development tools ..."
	@$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[dev]'
	@$(BYTECODE)
	@touch $@ $(VENV)/installed.stamp

clean:
	rm -rf $(VENV) jupyter_execute .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
