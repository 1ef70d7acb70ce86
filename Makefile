# `make demo` and `make test` need nothing but Python 3.11+ and a package index.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
SMALL_RUN := build/small-run
# Tests that need neither that run nor compiled kernels.
LIGHT := $(patsubst %,tests/test_%.py,docs kernel_cache sfm_joining io_pvl fuzz_readers architecture ingest_geometry)
ONE_THREAD := NUMBA_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1

.PHONY: demo demo-body docs test suite light small-run lint types check bench bench-full bench-update clean

# Modules are compiled when they are imported: most of what is installed never is.
$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable '.[dev]'
	@touch $@

demo: $(READY)  ## simulate a small site, map it, and say where the report is
	test -f demo/site/site.toml || $(BIN)/phomo simulate --preset demo --out demo/site
	$(BIN)/phomo run demo/site/site.toml --out demo/run
	$(BIN)/phomo evaluate demo/run --truth demo/site/truth.h5
	@echo report: demo/run/report/index.html

demo-body: $(READY)  ## minutes: simulate a small body, map it as a whole, and say where the report is
	test -f demo/body-site/site.toml || $(BIN)/phomo simulate --preset bilobed --views 100 --image-size 256 --pose-sigma 0.1 20 --out demo/body-site
	$(BIN)/phomo body demo/body-site/site.toml --out demo/body --workers 2 --plan.tile-px 96
	$(BIN)/phomo evaluate demo/body --truth demo/body-site/truth.h5
	@echo report: demo/body/report/index.html

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)  ## the checker is a wheel that brings its own Node.js: nothing is fetched from npm
	$(BIN)/basedpyright --pythonpath $(BIN)/python

check: lint types

# Its kernels are compiled, and the run is mapped, once: processes of the suite would each do both, all at once.
small-run: $(READY)  ## the run that many tests look at
	$(ONE_THREAD) $(BIN)/python tests/runs.py $(SMALL_RUN)

# One process more than cores, as commands and browsers are waited for; one thread a process, as kernels of so small maps
# wait for threads more than they compute; in the order of `tests/conftest.py`, not by numbers of tests.
suite: $(READY)  ## the tests alone
	$(ONE_THREAD) $(BIN)/python -m pytest --numprocesses $$(($$(getconf _NPROCESSORS_ONLN) + 1)) --dist loadscope --no-loadscope-reorder $(WITHOUT:%=--ignore=%)

light: check
	$(ONE_THREAD) $(BIN)/python -m pytest $(LIGHT)

test: $(READY)  ## style, types and light tests, beside the compilation of kernels; then all other tests
	$(MAKE) --jobs=2 small-run light
	SMALL_RUN=$(SMALL_RUN) $(MAKE) suite WITHOUT="$(LIGHT)"

$(VENV)/.docs: $(READY)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[docs]'
	@touch $@

docs: $(VENV)/.docs  ## minutes: the pages, with every example and the tutorial run; warnings are errors
	MPLBACKEND=agg $(BIN)/python -m sphinx -W --keep-going -b html docs build/docs
	@echo pages: build/docs/index.html

bench: $(READY)  ## minutes: accuracy, CPU seconds and memory against benchmarks/baselines/small.json
	$(BIN)/python benchmarks/bench.py

bench-full: $(READY)  ## hours: the full-size sites
	$(BIN)/python benchmarks/bench.py --suite full

bench-update: $(READY)  ## the small suite's outcome becomes the baseline
	$(BIN)/python benchmarks/bench.py --update

clean:
	rm -rf demo build dist
