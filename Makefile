# edofsim: everything runs from a virtual environment in this folder.
#   make run      set up what is missing, then the main job on the shipped desk scene
#   make test     set up what is missing, then the test suite
#   make check    set up what is missing, then the linter, the type checker and the test suite
#   make docs     set up what is missing, then the site, in docs/_build/html
SHELL := /bin/bash
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
	command -v $$p >/dev/null && $$p -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
SCENE ?= desk
OUT ?= out
# processes that share the tests; slow ones are run by themselves, since some measure seconds and memory
WORKERS ?= $(shell nproc 2>/dev/null || getconf _NPROCESSORS_ONLN)

.PHONY: help setup run check lint types test coverage test-all results-check results bench paper docs docs-same release clean
.DEFAULT_GOAL := help

help:
	@sed -n 's/^#  *//p' Makefile | head -5; echo "targets: setup run check lint types test coverage test-all results-check results bench paper docs docs-same release clean"

INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

# Three stamps: what running needs, and what tests, benchmarks, the linter and the type checker, and what the site
# need besides.
$(VENV)/.installed: pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "edofsim needs Python 3.11 or newer; install it and try again"; exit 2; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(INSTALL) -e .
	touch $@

$(VENV)/.installed-tools: $(VENV)/.installed
	$(INSTALL) -e '.[test]'
	touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(INSTALL) -e '.[docs]'
	touch $@

# A working LLVM: where no engine renders, apt as root or through password-less sudo, else the command to type.
setup: $(VENV)/.installed
	@$(BIN)/edofsim doctor || { \
	  sudo=$$([ "$$(id -u)" = 0 ] || echo "sudo -n"); \
	  echo "installing libllvm19"; \
	  { $$sudo apt-get update -qq && $$sudo apt-get install -y -qq libllvm19; } \
	    || { echo "type: sudo apt-get install libllvm19    (any LLVM from 17 on will do)"; exit 1; }; \
	  $(BIN)/edofsim doctor --again; }

run: setup
	$(BIN)/edofsim run $(SCENE) --out $(OUT)/$(SCENE) --json $(OUT)/$(SCENE)/run.json

check: lint types test

lint: $(VENV)/.installed-tools
	$(BIN)/ruff check edofsim tests benchmarks docs
	$(BIN)/ruff format --check --quiet edofsim tests benchmarks docs

types: $(VENV)/.installed-tools
	$(BIN)/pyrefly check

# with compiled files kept, which some machines are set not to: pytest compiles its asserts for 10 s a process
test: setup $(VENV)/.installed-tools
	OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -m "not slow" -n $(WORKERS) --maxprocesses 8 --dist worksteal $(PYTEST_ARGS)

# lines that `make test` runs; those that only processes of their own run are not counted
coverage: PYTEST_ARGS += --cov=edofsim --cov-report=term:skip-covered
coverage: test

test-all: test
	$(BIN)/python -m pytest -m slow $(PYTEST_ARGS)

# the figures of README and the site against the JSON files that commands wrote
results-check:
	@$(or $(wildcard $(BIN)/python),$(PYTHON)) docs/figures.py

# the pages of results, the README's figures and its chart from those JSON files
results: $(VENV)/.installed
	$(BIN)/python docs/figures.py --write
	$(BIN)/python docs/chart.py

bench: setup $(VENV)/.installed-tools
	$(BIN)/edofsim evaluate bench --json $(OUT)/bench.json

# PHOTOS=dir CUBES=path CHART=file name data of your own, FULL=1 takes the paper's sizes
paper: setup
	$(BIN)/edofsim evaluate paper --out $(OUT)/paper $(if $(PHOTOS),--photos $(PHOTOS)) $(if $(CUBES),--cubes $(CUBES)) \
	  $(if $(CHART),--chart $(CHART)) $(if $(FULL),--full)

# without a network once the tools are there; a warning is a failure
docs: setup $(VENV)/.installed-docs
	$(BIN)/python -m sphinx -q -W --keep-going -b html -d docs/_build/doctrees docs docs/_build/html
	@$(BIN)/python docs/built.py links docs/_build/html
	@cat docs/_build/html/gallery/times.txt
	@echo docs/_build/html/index.html

# builds the site twice from nothing, and compares all its files
docs-same:
	rm -rf docs/_build docs/gallery
	$(MAKE) docs
	mv docs/_build/html docs/_build/before
	rm -rf docs/_build/doctrees docs/gallery
	$(MAKE) docs
	@$(BIN)/python docs/built.py same docs/_build/before docs/_build/html

# what a release has: the wheel, the systems for comparison in a file of their own, and checksums
release: $(VENV)/.installed
	rm -rf dist
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .
	version=$$($(BIN)/python -c 'import edofsim; print(edofsim.__version__)'); \
	  cd train/checkpoints/comparisons && $(CURDIR)/$(BIN)/python -m zipfile -c $(CURDIR)/dist/edofsim-comparisons-$$version.zip *.safetensors
	cd dist && sha256sum * | tee SHA256SUMS

clean:
	rm -rf $(VENV) $(OUT) build dist *.egg-info docs/_build docs/gallery docs/sg_execution_times.rst
