# `make run` and `make test` each make a virtual environment in .venv and install what they need into it first.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
ARGS ?=

.PHONY: run test test-slow fuzz figures figures-status architecture settings site check typed clean

run: $(VENV)/installed
	$(VENV)/bin/cosim run $(ARGS)

# One thread for each of the two test processes: threads that compete for the cores double the CPU time of training.
test: $(VENV)/installed-dev
	OMP_NUM_THREADS=1 $(VENV)/bin/python -m pytest -n 2 --dist worksteal $(ARGS)

test-slow: $(VENV)/installed-dev
	$(VENV)/bin/python -m pytest -m slow $(ARGS)

fuzz: $(VENV)/installed-dev
	$(VENV)/bin/python -m pytest -m slow tests/test_damaged.py tests/isacsim/traffic/sources/test_damaged_recordings.py $(ARGS)

# STAGE: names of stages, or `list`, `keep`, `withdraw`. JOBS: stages side by side. CLUSTER: address of a scheduler.
FIGURES := $(VENV)/bin/python -m isac_cosim.benchmarks.findings.figures
figures: $(VENV)/installed-dev
	$(FIGURES) $(STAGE) --jobs $(or $(JOBS),1) $(if $(CLUSTER),--cluster $(CLUSTER))

figures-status: $(VENV)/installed-dev
	$(FIGURES) status

architecture: $(VENV)/installed-dev
	$(VENV)/bin/python -m isac_cosim.benchmarks.findings.architecture

settings: $(VENV)/installed-dev
	$(VENV)/bin/python -m isac_cosim.benchmarks.findings.settings_page

site: $(VENV)/installed-dev
	$(VENV)/bin/python -m sphinx -W -q -b html docs build/site

check: $(VENV)/installed-dev typed
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

# mypy follows no `__path__`: links to the packages stand in for it.
PACKAGES := base isacsim sumo_nets labeling models evaluation studies benchmarks command_line
typed:
	mkdir -p .typed/isac_cosim
	ln -sfn $(CURDIR)/isac_cosim/*.py $(CURDIR)/isac_cosim/py.typed $(addprefix $(CURDIR)/,$(PACKAGES)) .typed/isac_cosim/

clean:
	rm -rf $(VENV) .typed build dist *.egg-info

# pip compiles what it installs on one core; compileall uses them all, and leaves out the packages' own tests. Some
# packages ship templates that do not compile: like pip, go on without these.
define install
$(PYTHON) -m venv $(VENV)
$(VENV)/bin/python -m pip install --quiet --no-compile --editable '$(1)'
$(VENV)/bin/python -W ignore -m compileall -qq -j 0 -x '/tests?/' $(VENV)/lib || true
endef

$(VENV)/installed: pyproject.toml
	$(call install,.)
	touch $@

$(VENV)/installed-dev: pyproject.toml
	$(call install,.[dev])
	touch $@ $(VENV)/installed
