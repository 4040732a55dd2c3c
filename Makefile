# Everything a newcomer, a developer and CI need. Python 3.11 or newer, git and make are all that must be there.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TESTS ?=

.PHONY: help demo test test-slow attack lint check bench verify pictures clean

help:  ## Show the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

demo: $(VENV)/.installed  ## Run the friction masking experiment of the thesis
	$(BIN)/cls-bench run friction_masking

test: $(VENV)/.installed-dev  ## Run the tests
	$(BIN)/python -m pytest -n auto --dist loadfile -m "not slow" $(TESTS)

test-slow: $(VENV)/.installed-dev  ## Run all tests, the slow ones too
	$(BIN)/python -m pytest -n auto --dist loadfile $(TESTS)

attack: $(VENV)/.installed-dev  ## Kill, starve and mislead it a thousandfold, and count what was lost; some two hours
	$(BIN)/python -m tests.attacks $(ATTACK)

lint: $(VENV)/.installed-dev  ## Style, types and import contracts
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint test  ## What CI runs

verify: $(VENV)/.installed  ## Hold the plant against closed forms, independent integrations and published results
	$(BIN)/cls-bench verify

bench: $(VENV)/.installed-dev  ## Measure speed, as ratios side by side
	$(BIN)/python -m benchmarks

pictures: $(VENV)/.installed-dev  ## Make the pictures of README and gallery anew
	$(BIN)/python -m cls_bench.report.readme_pictures docs

clean:  ## Remove the virtual environment and all caches
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis

# Installed once, and again only when the versions change.
$(VENV)/.installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@ $(VENV)/.installed

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) else "cls-bench needs Python 3.11 or newer, found %d.%d; try: make PYTHON=python3.12" % v[:2])'
	$(PYTHON) -m venv $(VENV)
