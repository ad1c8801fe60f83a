# The same targets for people and for CI. Needs Python 3.11 or newer and make, nothing else.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
USE    := $(VENV)/.ready
DEVELOP := $(VENV)/.ready-dev
RUN    := $(BIN)/python
OUT    ?= demo-output
# A file of tests stays in one process, with what its tests share.
PYTEST := $(RUN) -m pytest --numprocesses logical --dist loadfile
# Byte code of everything would take 90 MB, that of what is used takes 40 MB (see below).
PIP    := $(RUN) -m pip --quiet --disable-pip-version-check install --no-compile

# Linear algebra on one thread unless a caller says otherwise: beside other work on the same cores
# more threads cost far more than they gain (docs/architecture.md).
export OPENBLAS_NUM_THREADS ?= 1

# Byte code is written when a module is first imported, also where the shell says otherwise: without
# it every process would translate its libraries again.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.PHONY: help demo test quick fuzz crash check audit docs bench requirements clean

help:  ## List the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 15

$(USE): requirements.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("exposight needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; name another with make PYTHON=…") if sys.version_info < (3, 11) else None'
	test -x $(RUN) || $(PYTHON) -m venv $(VENV)
	$(PIP) --require-hashes --no-deps -r requirements.txt
	$(PIP) --no-build-isolation --no-deps --editable .
	@$(RUN) -m pip --quiet uninstall --yes setuptools
	@touch $@

$(DEVELOP): $(USE) requirements-dev.txt
	$(PIP) --require-hashes --no-deps -r requirements-dev.txt
	@touch $@

demo: $(USE)  ## Run the whole method on a simulated cell and write a report
	$(BIN)/exposight demo --output $(OUT)

test: $(DEVELOP)  ## Run the tests
	$(PYTEST)

quick: $(DEVELOP)  ## Run the tests but for the slow ones
	$(PYTEST) -m "not slow"

fuzz: $(DEVELOP)  ## Read 5000 mutants of each format
	$(RUN) -m tests.fuzz.mutants

crash: $(DEVELOP)  ## Kill every command at every touch of the disk, and fill the disk there
	$(RUN) -m tests.crash.crash_points

check: $(DEVELOP)  ## Lint, check types strictly, check the import contract
	$(RUN) -m ruff format --check .
	$(RUN) -m ruff check .
	$(RUN) -m mypy
	$(BIN)/lint-imports --no-logo

audit: $(DEVELOP)  ## Look the pinned versions up among known vulnerabilities
	$(RUN) -m benchmarks.audit $(VENV)/audit

docs: $(DEVELOP)  ## Draw the pictures in docs/ again
	$(RUN) docs/draw_pictures.py

bench: $(DEVELOP)  ## Run a benchmark: make bench NAME=real
	@test -n "$(NAME)" || { echo "say which: make bench NAME=real"; exit 2; }
	$(RUN) -m benchmarks.$(NAME)

requirements: $(DEVELOP)  ## Pin the dependencies again, with hashes and without addresses
	$(PIP) uv
	for extras in "requirements.txt" "requirements-dev.txt --extra dev --extra cluster --extra e57 --extra cad --extra service --extra rc-visard"; do \
	  $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header \
	    --no-emit-index-url --no-emit-find-links --no-annotate --extra build pyproject.toml \
	    --output-file $$extras; done

clean:  ## Remove the environment and caches
	rm -rf $(VENV) .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find src -name '*.nb[ic]' -delete
