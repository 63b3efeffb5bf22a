# edofsim: everything runs from a virtual environment in this folder.
#   make run      set up what is missing, then the main job on the shipped desk scene
#   make test     set up what is missing, then the test suite
SHELL := /bin/bash
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
	command -v $$p >/dev/null && $$p -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
SCENE ?= desk
OUT ?= out

.PHONY: help setup run test test-all bench paper lint clean
.DEFAULT_GOAL := help

help:
	@sed -n 's/^#  *//p' Makefile | head -3; echo "targets: setup run test test-all bench lint clean"

$(VENV)/.installed: pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "edofsim needs Python 3.11 or newer; install it and try again"; exit 2; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test,bench,cluster]'
	touch $@

setup: $(VENV)/.installed
	@$(BIN)/edofsim doctor --install

run: setup
	$(BIN)/edofsim run $(SCENE) --out $(OUT)/$(SCENE) --json $(OUT)/$(SCENE)/run.json

test: setup
	$(BIN)/python -m pytest -m "not slow" $(PYTEST_ARGS)

test-all: setup
	$(BIN)/python -m pytest $(PYTEST_ARGS)

lint: $(VENV)/.installed
	$(BIN)/ruff check edofsim tests

clean:
	rm -rf $(VENV) $(OUT) build dist *.egg-info
