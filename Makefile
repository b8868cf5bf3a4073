# make demo: install into .venv, run the quick demo, analyse it     make test: the tests and the checks of style
# make findings: what other packages do that one would guess wrong; installs them into temporary folders
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml configs/demo.yaml $(shell find suspend cli -name '*.py' -o -path 'suspend/data/*' -type f -not -name '*.pyc')

# An inherited PYTHONPATH would let the tests see another copy of the package than the installed one.
unexport PYTHONPATH PYTHONHOME

.DELETE_ON_ERROR:
.PHONY: demo test long extreme lint findings clean

demo: $(VENV)/.installed
	$(BIN)/suspend run configs/demo.yaml --output demo-run
	$(BIN)/suspend analyze demo-run --plot demo-run/first_figure.png
	@echo "Figure: demo-run/first_figure.png"

test: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -q
	$(MAKE) --no-print-directory lint

long: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -q -m long

extreme: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/extremes.py

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/interrogate suspend cli

findings:
	PYTHON=$(PYTHON) bash findings/run_all.bash

clean:
	rm -rf $(VENV) demo-run build dist suspend.egg-info .pytest_cache .ruff_cache .import_linter_cache
	find suspend cli tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/python:
	$(PYTHON) -c 'import sys; v = sys.version_info; v >= (3, 11) or sys.exit(f"suspend needs Python 3.11 or newer; $(PYTHON) is {v[0]}.{v[1]}: make PYTHON=python3.11 ...")'
	rm -rf $(VENV)
	$(PYTHON) -m venv $(VENV)

# Once the editable installation is there it shows every change of the sources, and must not be replaced by a copy.
# `build` goes first: setuptools would pack the modules that an earlier build left there. So does the demo's run: changed
# sources may have other defaults, and a run is never continued with another configuration.
$(VENV)/.installed: $(SOURCES) | $(BIN)/python
	rm -rf build demo-run
	test -e $(VENV)/.installed-dev || $(BIN)/python -m pip install --quiet .
	touch $@

# A copy that ran leaves its compiled kernels behind when it is uninstalled; as a namespace package that folder would
# hide the editable installation.
$(VENV)/.installed-dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip uninstall --quiet --yes suspend
	rm -rf $(VENV)/lib/python*/site-packages/suspend $(VENV)/lib/python*/site-packages/suspend_cli
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@
