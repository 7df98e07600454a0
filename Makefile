# RENEW: `make help` lists what there is.

SHELL := /bin/sh
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

VENV := .venv
BIN := $(VENV)/bin
# Two stages of one environment: a scenario is planned after the first. The lock is in two parts, with this line between.
READY := $(VENV)/.ready
COMPLETE := $(VENV)/.complete
BESIDES := What tests and documents need besides
SCENARIOS := $(basename $(notdir $(wildcard catalog/scenarios/*.toml)))

# A Python that fits: PYTHON=... where it is given, else the first of the usual names that runs, is 3.11 to 3.14 and can
# make an environment. The probe prints its real path, so that an active .venv is never made from itself.
PYTHON ?= python3.11 python3.12 python3.13 python3.14 python3
PROBE := import ensurepip, os, sys, venv; (3, 11) <= sys.version_info < (3, 15) or sys.exit(1); print(os.path.realpath(sys.executable))

# What set-up has not compiled is, once, where it is first imported.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup test lint types pytest compiled format test-slow test-new-examples test-no-compiler bench pictures figures reference docs notebooks lock qgis-plugin wheel clean nightly experiments experiments-quick $(SCENARIOS)

help:  ## this list
	@printf '  make %-18s %s\n' $(foreach name,$(SCENARIOS),$(name) 'plan this scenario: outputs/$(name)/')
	@sed -n 's/^\([a-z-]*\):.*## /\1\n/p' $(MAKEFILE_LIST) | while read -r name && read -r text; do \
	  printf '  make %-18s %s\n' "$$name" "$$text"; done

setup: $(COMPLETE)  ## make .venv from requirements.lock: what plans need, then what tests and documents need besides

# $(call install,WHAT): by uv, in a quarter of pip's time; by pip where uv has no build or does not reach the registry.
define install
"$$uv" pip install --quiet --python $(BIN)/python --no-deps $(1) 2> $(VENV)/uv.log || { cat $(VENV)/uv.log; \
  $(BIN)/python -m pip install $(PIP_OPTIONS) --no-deps $(1); }
endef
PIP_OPTIONS := --quiet --disable-pip-version-check --no-input --no-compile

# A run starts several processes, which would compile the same modules each for itself: compileall takes every core. Half
# of the libraries' modules are their tests.
$(READY): pyproject.toml requirements.lock
	@for name in $(PYTHON); do python=$$("$$name" -c '$(PROBE)' 2>/dev/null) && break; done; \
	if [ -z "$$python" ]; then \
	  echo "make setup: found no Python 3.11 to 3.14 with venv as $(PYTHON); install one, or name it: make setup PYTHON=/path/to/python3.11" >&2; \
	  exit 2; fi; \
	set -e; echo "Setting up $(VENV) with $$python"; rm -rf $(VENV); \
	if uv=$$(command -v uv); then "$$uv" venv --quiet --python "$$python" $(VENV); \
	else \
	  uv=$(BIN)/uv; "$$python" -m venv $(VENV); sed -n '/^uv==/,/# via/p' requirements.lock > $(VENV)/part.lock; \
	  $(BIN)/python -m pip install $(PIP_OPTIONS) --only-binary :all: --require-hashes --requirement $(VENV)/part.lock || true; \
	fi; \
	sed '/$(BESIDES)/,$$d' requirements.lock > $(VENV)/part.lock; \
	$(call install,--require-hashes --requirement $(VENV)/part.lock); \
	$(call install,--no-build-isolation --editable .); \
	$(BIN)/python -m compileall -qq -j 0 -x '/tests?/' $(VENV)/lib || true; \
	touch $@

$(COMPLETE): $(READY)
	@set -e; echo "Setting up what tests and documents need besides"; uv=$$(command -v uv || echo $(BIN)/uv); \
	sed '1,/$(BESIDES)/d' requirements.lock > $(VENV)/part.lock; \
	$(call install,--require-hashes --requirement $(VENV)/part.lock); \
	touch $@

test: $(COMPLETE)  ## the gate: style, types, import rules, tests; all of them, though one may fail
	@$(MAKE) --no-print-directory --keep-going --jobs=2 lint types pytest

lint: $(COMPLETE)  ## ruff: rules and format
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: $(COMPLETE)  ## mypy, strict
	$(BIN)/mypy

# The times of all tests are in build/test-times.xml (JUnit's format), the slowest at the end. A process that has run its
# half of the tests takes some of the other's.
TIMED := --dist worksteal --durations=20 --durations-min=2 --junitxml=build/test-times.xml

# A test that waits for a browser, a cluster or a program leaves its core to others: `make test PROCESSES=3` may be quicker
# on two cores, though each test then takes longer.
PROCESSES := 2

pytest: $(COMPLETE) compiled  ## the quick tests, the import rules and the documents' examples
	RENEW_IS_WARM=1 $(BIN)/python -m pytest -q -n $(PROCESSES) $(TIMED)

# Before the tests, whose processes would compile everything each for itself; while mypy works on the other core.
compiled: $(READY)  ## the machine code of the planner
	@$(BIN)/renew warm

# They often wait for others: for browsers, servers, limits that run out.
test-slow: PROCESSES := 3
test-slow: $(COMPLETE) compiled  ## the slow tests
	RENEW_IS_WARM=1 $(BIN)/python -m pytest -q -m slow -n $(PROCESSES) --dist worksteal --durations=40 --durations-min=10 --junitxml=build/slow-test-times.xml

# The gate draws the same examples each time. What these find becomes an @example of the test.
test-new-examples: $(COMPLETE) compiled  ## all property tests with new examples; SEED=... draws those of a run again
	@seed=$${SEED:-$$(date +%s)}; echo "Seed $$seed: make test-new-examples SEED=$$seed draws these examples again; one test does by"; \
	echo "  $(BIN)/python -m pytest --hypothesis-profile=new-examples --hypothesis-seed=$$seed TEST"; \
	$(BIN)/python -m pytest -q -n $(PROCESSES) -m 'hypothesis and not network' --hypothesis-profile=new-examples --hypothesis-seed=$$seed

# What exercises the kernels and the planner; less what plans several times for something else (pickling, printing, seeds,
# triangulators), so that it ends within minutes. Compiled code does not warn of inf - inf, as NumPy's numbers do.
NO_COMPILER := $(addprefix tests/renew/,kernels classes inputs voyage turns test_planner.py) --ignore=tests/renew/turns/test_padding_monte_carlo.py

test-no-compiler: $(COMPLETE)  ## the kernels' and the planner's quick tests, interpreted: Numba switched off
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -q -n $(PROCESSES) --dist worksteal $(NO_COMPILER) \
	  -W 'ignore:invalid value encountered in scalar:RuntimeWarning' \
	  -k 'not pickling and not print_and_compare and not same_seed and not same_classes'

format: $(COMPLETE)  ## let ruff mend what it can
	$(BIN)/ruff check --fix --exit-zero
	$(BIN)/ruff format

nightly: $(READY)  ## a night that runs offline: outputs/nightly/latest/
	$(BIN)/renew nightly run

experiments: $(COMPLETE)  ## the paper's tables again, with its baselines and stronger rivals: outputs/experiments/
	$(BIN)/python -m experiments

experiments-quick: $(COMPLETE)  ## the same for single gyre and 4-gyre, one seed, small budgets
	$(BIN)/python -m experiments --quick

bench: $(COMPLETE)  ## the figures to reach, as a table
	$(BIN)/python -m tests.bench

pictures: $(COMPLETE)  ## the documents' pictures anew: docs/pictures/
	$(BIN)/python -m tests.pipeline.formats.figures

# Suites of tests/bench whose figures pages quote.
QUOTED := padding draws gyre sampled published triangulators scenes sides offing

figures: $(COMPLETE)  ## measure what pages quote: docs/figures/*.csv; then tests/test_claims.py names each page that differs
	$(BIN)/renew run palawan-season --offline
	cp outputs/palawan-season/metrics.csv docs/figures/palawan-season.csv
	$(BIN)/python -m tests.reference
	$(BIN)/python -m tests.bench --record $(QUOTED)

reference: $(COMPLETE)  ## the reference of a scenario's keys, its JSON schema, all commands and a route's figures: docs/reference/, outputs/README.md
	$(BIN)/python -m tests.reference

# -W: a broken link, a public name without docstring or a cell that was not executed fails the build. -E: nothing is left
# from an earlier one. It loads nothing from the network.
docs: $(COMPLETE)  ## the site, strict: build/site/index.html
	$(BIN)/python -m sphinx -W --keep-going -E -q -b html docs build/site
	@echo "The site: build/site/index.html"

notebooks: $(COMPLETE)  ## execute docs/notebooks/*.md into docs/tutorials/*.ipynb
	$(BIN)/python -m tests.notebooks

# A folder in a zip, as "Install from ZIP" of QGIS's plugin manager takes it.
qgis-plugin: $(COMPLETE)  ## build dist/renew_routes.zip, the plugin for QGIS
	mkdir -p dist
	cd qgis && ../$(BIN)/python -m zipfile -c ../dist/renew_routes.zip renew_routes

wheel: $(COMPLETE)  ## build dist/*.whl
	$(BIN)/python -m hatchling build -t wheel

# Versions alike for all Pythons; FORKS=requires-python takes the newest for each.
FORKS := fewest
RESOLVE = uv pip compile --quiet --no-config --universal --fork-strategy $(FORKS) --generate-hashes --python-version 3.11 \
  --no-emit-index-url --no-emit-find-links --custom-compile-command 'make lock' --extra tides --extra web
lock:  ## resolve requirements.lock anew (needs uv)
	mkdir -p build
	$(RESOLVE) --group dev --group docs --extra grib --extra triangle $(UPGRADE) --output-file requirements.lock pyproject.toml
	$(RESOLVE) --group install --constraint requirements.lock --output-file build/plans.lock pyproject.toml
	awk 'FNR < NR && FNR == 1 {print "\n# $(BESIDES)"} /^[^ #]/ {known = FNR < NR && $$0 in first; first[$$0]} FNR == NR || /^[^#]/ && !known' \
	  build/plans.lock requirements.lock > build/requirements.lock
	mv build/requirements.lock requirements.lock

clean:  ## remove .venv, caches and packages (not outputs/)
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache renew/__pycache__

# A scenario of the catalogue by its name: `make palawan-season`; with the user's own chart or currents:
# `make boston-enc CHARTS=ENC_ROOT CURRENTS=still`.
$(SCENARIOS): $(READY)
	$(BIN)/renew run $@ $(if $(CHARTS),--charts "$(CHARTS)") $(if $(CURRENTS),--currents "$(CURRENTS)")
