# `make demo` and `make test` need nothing but Python 3.11+ and a package index.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: demo test check clean

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@

demo: $(READY)  ## simulate a small site, map it, and say where the report is
	$(BIN)/phomo simulate --preset demo --out demo/site
	$(BIN)/phomo run demo/site/site.toml --out demo/run
	$(BIN)/phomo evaluate demo/run --truth demo/site/truth.h5

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

test: check
	$(BIN)/python -m pytest

clean:
	rm -rf demo build dist
