# `make run` and `make test` each make a virtual environment in .venv and install what they need into it first.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
ARGS ?=

.PHONY: run test test-slow check clean

run: $(VENV)/installed
	$(VENV)/bin/cosim run $(ARGS)

test: $(VENV)/installed-dev
	$(VENV)/bin/python -m pytest -n 2 --dist worksteal $(ARGS)

test-slow: $(VENV)/installed-dev
	$(VENV)/bin/python -m pytest -m slow $(ARGS)

check: $(VENV)/installed-dev
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

clean:
	rm -rf $(VENV) build dist *.egg-info

$(VENV)/installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --editable .
	touch $@

$(VENV)/installed-dev: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --editable '.[dev]'
	touch $@ $(VENV)/installed
