# Every target sets itself up: `make demo` and `make test` are all a new user needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# One BLAS thread: on two cores OpenBLAS' own threads make least squares 10 to 200 times slower.
export OPENBLAS_NUM_THREADS := 1

.PHONY: setup venv demo test slow style lint bench benchmarks evidence gate plain fuzz kills docs clean

# Python compiles what it imports; compiling all that is installed beforehand takes longer than the install.
PIP := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt

setup: $(VENV)/.ready

venv:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "pinotwin needs Python 3.11 or newer")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)

$(VENV)/.ready: pyproject.toml constraints.txt | venv
	$(PIP) -e '.[dev]'
	touch $(VENV)/.usable $@

# What a user needs, without the tools of a developer.
$(VENV)/.usable: pyproject.toml constraints.txt | venv
	$(PIP) -e .
	touch $@

demo: $(VENV)/.usable
	$(BIN)/pinotwin demo

style: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

lint: style
	$(BIN)/mypy

# A file stays with one worker, which then makes its fixtures once. Long files come first (tests/conftest.py).
PYTEST := $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

# The types are a test among them.
test: style
	$(PYTEST) -m "not slow"

# Examples of whole machines, `--each` and other tests of half a minute: four minutes more.
slow: setup
	$(PYTEST) -m slow

# The withheld bench: the table of docs/bench_results.md. Interrupted, it goes on where it stopped.
bench: setup
	mkdir -p out
	$(BIN)/pinotwin blind --seeds 4 --out out/bench

# Speed and accuracy of every part beside its peers.
benchmarks: setup
	$(BIN)/python -m benchmarks

# The figures of README and docs: docs/figures.json and figures.md. Parts alone:
# `python -m benchmarks evidence emps tx40`; `--list` says what there is.
evidence: setup
	$(BIN)/python -m benchmarks evidence

# Questions with known answers that the diagnosis must not get wrong: own, foreign and real machines.
# `make gate GATE=--quick` is a part of them.
gate: setup
	$(BIN)/python -m benchmarks gate $(GATE)

# Source archive, wheel, an install without a developer's tools, and every command of the README in it.
plain:
	$(PYTHON) .ci/plain_install

# Machines, truths and logs spoiled in other places than in the suite, ten times as many; then 10,000 spoiled files
# for each reader; hours. The suite reads 40 of each.
fuzz: setup
	PINOTWIN_FUZZ=1500 $(BIN)/python -m pytest -q tests/test_machine_fuzz.py
	PINOTWIN_FUZZ=250 $(BIN)/python -m pytest -q tests/test_bad_input_fuzz.py
	$(BIN)/python -m tests.fuzz --count 10000

# 200 kills over all commands, full disks, folders that may not be written to; half an hour. The suite kills a dozen.
kills: setup
	$(BIN)/python -m tests.kills --count 200

clean:
	rm -rf $(VENV) build dist *.egg-info out

# Writes site/index.html; needs no network. The pages of the gallery take some minutes, once (out/gallery).
docs: setup
	$(BIN)/python docs/generate_effects.py
	$(BIN)/python docs/generate_schema.py
	$(BIN)/python docs/generate_gallery.py
	$(BIN)/python -m mkdocs build --strict --quiet
