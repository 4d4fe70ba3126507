# `make` lists the targets. The virtual environment is made on first use, and again when what it holds changes.
PYTHON ?= python3
VENV ?= .venv
ARGS ?=
WORKERS ?= 2

EGL_PACKAGES := libegl1 libgl1 libgl1-mesa-dri
READY := $(VENV)/installed
DOCS_READY := $(VENV)/installed-docs
RUN := $(VENV)/bin/python
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check install --quiet --constraint constraints.txt
PYTEST := OMP_NUM_THREADS=1 $(RUN) -m pytest -n $(WORKERS)

.PHONY: help train infer evaluate servo serve reproduce data doctor test test-fast robustness lint docs package clean
help: ## show this list
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 12

train: $(READY) ## learn a skill, simulated sorting or a video of yours: make train ARGS="kernel=p2p task=video task.path=DIR_OR_FILE"
	@$(RUN) train.py $(ARGS)

infer: $(READY) ## ask a skill: make infer ARGS="skill=RUN/skill.ckpt video=VIDEO"
	@$(RUN) infer.py $(ARGS)

evaluate: $(READY) ## score a skill: make evaluate ARGS="skill=RUN/skill.ckpt video=DIR regions=FILE"
	@$(RUN) evaluate.py $(ARGS)

servo: $(READY) ## close the loop in simulation: make servo ARGS="faults=all" or ARGS="plant=scene skill=RUN/skill.ckpt"
	@$(RUN) servo.py $(ARGS)

serve: $(READY) ## tell other programs live what a skill selects: make serve ARGS="skill=RUN/skill.ckpt video=0"
	@$(RUN) serve.py $(ARGS)

reproduce: $(READY) ## train and score over several seeds: make reproduce ARGS="artifact.data=DIR"
	@$(RUN) reproduce.py $(ARGS)

data: $(READY) ## fetch the real demonstrations of the results from their authors' repository, into data/
	@$(RUN) -m geoskill.cli.data

doctor: $(READY) ## versions, devices, codecs, rendering, and what to do about what is missing
	@$(RUN) -m geoskill.cli.doctor

test: $(READY) ## all tests
	$(PYTEST) $(ARGS)

test-fast: $(READY) ## the tests that take less than a second each
	$(PYTEST) -m "not slow" $(ARGS)

robustness: $(READY) ## attacks for half an hour: damaged files, hostile checkpoints, kills; ROBUSTNESS_ROUNDS=2000 of each kind
	ROBUSTNESS_ROUNDS=$${ROBUSTNESS_ROUNDS:-2000} $(PYTEST) tests/robustness $(ARGS)

lint: $(READY) ## style, types, and the direction of imports
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy
	$(VENV)/bin/lint-imports --no-logo

docs: $(DOCS_READY) ## the documentation, into build/docs; a warning is an error
	$(RUN) -m sphinx --fail-on-warning --keep-going --quiet -b html docs build/docs
	@echo build/docs/index.html

package: $(READY) ## source archive and wheel for a package index, into dist/, checked
	rm -rf dist
	$(RUN) -m build --outdir dist
	$(RUN) -m twine check --strict dist/*

clean: ## remove the virtual environment and caches; runs under outputs/ stay
	rm -rf $(VENV) build dist docs/_generated .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis

$(DOCS_READY): $(READY)
	@$(PIP) --editable ".[docs]"
	@touch $@

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "$(PYTHON) is $$($(PYTHON) --version 2>&1 || true); expected Python 3.11 or later (PYTHON=python3.12 make ...)" >&2; \
		exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
			echo "$(PYTHON) cannot make virtual environments; running apt-get install python3-venv" >&2; \
			apt-get update -qq && apt-get install -y -qq python3-venv; \
		else \
			echo "$(PYTHON) cannot make virtual environments; on Debian: sudo apt-get install python3-venv" >&2; \
			exit 1; \
		fi; }
	@echo "installing into $(VENV), once; this takes some minutes and 3 GB, more where PyTorch comes with CUDA" >&2
	@$(PYTHON) -m venv $(VENV)
	@echo "1 of 2: PyTorch" >&2
# Alone and by its exact version, so that nothing else decides which build of PyTorch comes.
	@$(PIP) "$$(grep '^torch==' constraints.txt)"
	@echo "2 of 2: geoskill, and what it and its tests need" >&2
	@$(PIP) --editable ".[dev]"
# The simulated tasks are rendered through EGL, which is no Python package.
	@$(RUN) -c 'import ctypes.util, sys; sys.exit(sys.platform == "linux" and not ctypes.util.find_library("EGL"))' || { \
		if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
			echo "no EGL for rendering; running apt-get install $(EGL_PACKAGES)" >&2; \
			apt-get update -qq && apt-get install -y -qq $(EGL_PACKAGES); \
		else \
			echo "no EGL: the simulated tasks cannot be rendered; on Debian: sudo apt-get install $(EGL_PACKAGES)" >&2; \
		fi; }
	@touch $@
