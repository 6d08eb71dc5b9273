# Everything here needs only python3 (3.11 or newer) and make; `make setup` builds .venv/ from pinned versions.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.ready
TOOLS  := $(VENV)/.tools
BEGAN  := $(shell date +%s)
# one study for `make run`, any name: make STUDY='studies/my study.yaml' run
export STUDY ?=
# studies that `make` runs, published tables first: patterns, for the shell
STUDIES ?= studies/*_table*.yaml studies/*.yaml
# two processes share the studies, six at a time: one draws pages while the other computes
EACH_ONCE := awk '!seen[$$0]++' | tr '\n' '\0' | xargs -0 -n 6 -P 2
# benchmarks of tests/bench: kernels (field, rays and compile), study, and chain and electricity (need PySAM);
# --page=docs/scaling.md writes the table of the documentation
BENCH ?= kernels study
PYTEST_ARGS ?=
# two processes share the tests, or as many as make PYTEST_ARGS="--maxprocesses 8" test says; --pdb takes one
SHARED := -n logical --maxprocesses 2 --dist worksteal
# processes that share the processors gain nothing from threads of matrix products: these wait for each other
test long: export OPENBLAS_NUM_THREADS ?= 1
# the C library returns freed memory to the system: a process of tests is smaller by a quarter
test long: export MALLOC_MMAP_THRESHOLD_ ?= 262144
test long: export MALLOC_TRIM_THRESHOLD_ ?= 1048576
test long: export MALLOC_ARENA_MAX ?= 2

# compiled modules are kept, whatever the shell says: without them each start takes 2 s more
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := studies
.PHONY: studies run test long mutants check docs reference index bench setup dist lock audit clean help

studies: $(STAMP)  ## set up and run every study in studies/ (the default)
	@printf '%s\n' $(STUDIES) | $(EACH_ONCE) $(BIN)/heliosweep run

run: $(STAMP)  ## run one study: make STUDY=studies/my_study.yaml run
	@test -n "$$STUDY" || { echo "say which study: make STUDY=studies/my_study.yaml run" >&2; exit 2; }
	@$(BIN)/heliosweep run "$$STUDY"

test: $(TOOLS)  ## set up and run the tests
	@$(BIN)/python -m pytest $(SHARED) $(PYTEST_ARGS)

long: $(TOOLS)  ## the long tests: hard fields, many seeds, other processors, faults of disk and machine
	@$(BIN)/python -m pytest $(SHARED) -m long $(PYTEST_ARGS)

mutants: $(TOOLS)  ## put small faults into the code: which of them does no test catch? make MUTANTS="energy.py" mutants: some
	@$(BIN)/python -m tests.mutants $(MUTANTS)

check: $(TOOLS)  ## lint, formatting and types
	@$(BIN)/ruff check pipeline tests docs
	@$(BIN)/ruff format --check pipeline tests docs
	@$(BIN)/mypy

docs: $(TOOLS)  ## the documentation, in docs/_build/html; warnings are errors
	@$(BIN)/python -m sphinx -W --keep-going -n -E -a -q -b html docs docs/_build/html
	@echo docs/_build/html/index.html

reference: $(TOOLS)  ## after a change of keys: the tables of keys in docs/reference/
	@$(BIN)/python docs/_ext/study_keys.py

index: $(TOOLS)  ## after make: state numbers and verdicts in studies/published/, and the index of papers in studies/README.md
	@$(BIN)/python -m tests.literature.index

bench: $(TOOLS)  ## speed of kernels and commands; make BENCH="rays study" bench: those
	@$(BIN)/python -c "import PySAM" 2>/dev/null || $(INSTALL) -e '.[sam]' \
	  || echo "nrel-pysam does not install here; the benchmark goes on without it" >&2
	@$(BIN)/python -m tests.bench $(BENCH)

setup: $(STAMP)  ## build the environment in .venv/, with all that runs studies

# one call of pip, wheels only; Python compiles modules when they are first imported
INSTALL = PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install -q --no-compile --only-binary :all: -c constraints.txt

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "heliosweep needs Python 3.11 or newer; name one with make PYTHON=python3.12" >&2; exit 2; }
	@echo "setting up $(VENV)/ (once)" >&2
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(INSTALL) -e '.[all]'
	@$(BIN)/heliosweep setup
	@echo "set up in $$(($$(date +%s) - $(BEGAN))) s" >&2
	@touch $@

$(TOOLS): $(STAMP)
	@echo "adding the tools of tests, checks and documentation to $(VENV)/ (once)" >&2
	@$(INSTALL) -e '.[test,check,docs]'
	@touch $@

dist: $(TOOLS)  ## build wheel and source archive in dist/, and test the wheel in an empty environment
	@rm -rf dist && $(BIN)/python -m pip install -q build && $(BIN)/python -m build -q
	@$(BIN)/python tests/wheel.py dist/*.whl

lock: $(STAMP)  ## pin the versions of all dependencies in constraints.txt
	@$(PYTHON) -m venv $(VENV)/tools && $(VENV)/tools/bin/python -m pip install -q uv
	@$(VENV)/tools/bin/uv pip compile -q --universal --python-version 3.11.7 --no-emit-index-url --no-annotate \
	  --custom-compile-command "make lock" --extra all --extra images --extra terrain --extra test --extra check --extra docs \
	  -o constraints.txt pyproject.toml

audit: $(STAMP)  ## look up the pinned versions among known vulnerabilities, where that list can be had
	@$(PYTHON) -m venv $(VENV)/tools && $(VENV)/tools/bin/python -m pip install -q pip-audit
	@$(VENV)/tools/bin/pip-audit --strict --no-deps --disable-pip -r constraints.txt \
	  || { echo "some versions are vulnerable, or could not be looked up from here: see above" >&2; exit 1; }

clean:  ## remove the environment and caches, keep outputs/
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache
	find pipeline tests -name __pycache__ -type d -prune -exec rm -rf {} +

help:  ## this list
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):[^#]*## /\1\t/' | expand -t 10
