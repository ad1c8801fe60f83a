# The same targets for people and for CI. Needs Python 3.11 or newer and make, nothing else.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
SOURCES := $(VENV)/.sources
RUN    := $(BIN)/python
OUT    ?= demo-output

# Linear algebra on one thread unless a caller says otherwise: beside other work on the same cores
# more threads cost far more than they gain (docs/architecture.md).
export OPENBLAS_NUM_THREADS ?= 1

.DEFAULT_GOAL := help
.PHONY: help demo test check docs bench requirements clean

help:  ## List the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 15

$(READY): requirements.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("exposight needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; name another with make PYTHON=…") if sys.version_info < (3, 11) else None'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps -r requirements.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	@touch $@

# numba keeps a compiled loop although another module that it calls has changed; so nothing compiled
# outlives a change of the sources.
$(SOURCES): $(READY) $(shell find src -name '*.py')
	find src -name '*.nb[ic]' -delete
	@touch $@

demo: $(SOURCES)  ## Run the whole method on a simulated cell and write a report
	$(BIN)/exposight demo --output $(OUT)

test: $(SOURCES)  ## Run the tests
	$(RUN) -m pytest

check: $(READY)  ## Lint, check types strictly, check the import contract
	$(RUN) -m ruff format --check .
	$(RUN) -m ruff check .
	$(RUN) -m mypy
	$(BIN)/lint-imports --no-logo

docs: $(SOURCES)  ## Draw the pictures in docs/ again
	$(RUN) docs/draw_pictures.py

bench: $(SOURCES)  ## Run a benchmark: make bench NAME=real
	@test -n "$(NAME)" || { echo "say which: make bench NAME=real"; exit 2; }
	$(RUN) -m benchmarks.$(NAME)

requirements:  ## Pin the dependencies again, with hashes and without addresses
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header \
	  --no-emit-index-url --no-emit-find-links --no-annotate --extra dev --extra cluster pyproject.toml --output-file requirements.txt

clean:  ## Remove the environment and caches
	rm -rf $(VENV) .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find src -name '*.nb[ic]' -delete
