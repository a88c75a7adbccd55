# Everything runs in .venv, which `make setup` builds from requirements.lock.
# `make help` lists the targets; `make test` and `make vcan` are the whole of CI.

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.NOTPARALLEL:
.ONESHELL:
.DELETE_ON_ERROR:

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PYTHON ?=
WORKERS ?= 2
MISSION ?= hyperion-1
LAW ?= lqy

# Imports take three times as long without byte code.
export PYTHONDONTWRITEBYTECODE :=

# The environment holds exactly what the lock names, whatever the caller's own settings are.
PIP := env -u PIP_REQUIRE_VIRTUALENV -u PIP_USER -u PIP_TARGET -u PYTHONPATH \
       $(BIN)/python -m pip --disable-pip-version-check --quiet
PYTEST := $(BIN)/python -m pytest
PARALLEL := -n $(WORKERS) --dist loadfile

# Where kernels are exercised one by one; whole flights live in tests/system and tests/replay.
KERNEL_TESTS = $(wildcard tests/flight_sw tests/sim_harness)
CODE = flight_sw sim_harness tools tests $(wildcard benchmarks)

.PHONY: help
help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# --- environment -------------------------------------------------------------------------------

.PHONY: setup
setup: $(STAMP) ## build .venv from the hashed lock (PYTHON=... chooses the interpreter)

$(STAMP): requirements.lock pyproject.toml
	@python="$$(PYTHON='$(PYTHON)' bash .ci/find-python)"
	if ! $(BIN)/python -c 'import pip, sys; raise SystemExit(sys.version_info < (3, 11))' 2>/dev/null
	then
	  echo "setup: making $(VENV) with $$python ($$("$$python" -V))"
	  "$$python" -m venv --clear $(VENV)
	fi
	echo "setup: installing requirements.lock"
	$(PIP) install --require-hashes --no-deps -r requirements.lock
	$(PIP) install --no-deps --no-build-isolation -e .
	touch $@

.PHONY: lock
lock: ## choose the newest allowed versions anew and write requirements.lock
	@tool="$$(mktemp -d)"
	trap 'rm -rf "$$tool"' EXIT
	python="$$(PYTHON='$(PYTHON)' bash .ci/find-python)"
	"$$python" -m venv "$$tool"
	"$$tool/bin/python" -m pip --disable-pip-version-check --quiet install uv
	env -u UV_INDEX -u UV_DEFAULT_INDEX -u UV_EXTRA_INDEX_URL UV_CUSTOM_COMPILE_COMMAND="make lock" \
	  "$$tool/bin/uv" pip compile --quiet --universal --fork-strategy fewest --generate-hashes \
	  --upgrade --no-emit-index-url --no-emit-find-links --no-config --python-version 3.11 \
	  --extra dev --output-file requirements.lock pyproject.toml

# --- flying ------------------------------------------------------------------------------------

.PHONY: fly
fly: setup ## fly MISSION (hyperion-1) with LAW (lqy)
	@$(BIN)/aeroshell fly $(MISSION) --law $(LAW)

.PHONY: gains-check
gains-check: setup ## regenerate every load image and compare with the committed one
	@for design in gains/*/design.toml; do
	  $(BIN)/aeroshell gains "$$(basename "$$(dirname "$$design")")" --check
	done

.PHONY: bench
bench: setup ## measure speed; run it on an otherwise idle machine
	@$(PYTEST) benchmarks -o addopts= -o python_files='bench_*.py test_*.py' -p no:xdist -s -q

# --- checking ----------------------------------------------------------------------------------

.PHONY: test
test: lint types spelling test-compiled test-uncompiled test-bounds ## all that CI runs

.PHONY: lint
lint: setup ## ruff: rules and format
	@echo "== lint"
	$(BIN)/ruff check --quiet $(CODE)
	$(BIN)/ruff format --quiet --check $(CODE) || \
	  { echo "lint: mend with $(BIN)/ruff format"; exit 1; }

.PHONY: types
types: setup ## mypy --strict on the flight software and the tools
	@echo "== types"
	$(BIN)/mypy --no-error-summary

.PHONY: spelling
spelling: setup ## codespell
	@echo "== spelling"
	$(BIN)/codespell

.PHONY: test-compiled
test-compiled: setup ## the suite, compiled
	@echo "== tests, compiled"
	$(PYTEST) -q $(PARALLEL) -m "not slow and not alone and not vcan" tests
	echo "== tests that run alone"
	$(PYTEST) -q -p no:xdist -m "alone and not slow and not vcan" tests || [ $$? -eq 5 ]

.PHONY: test-uncompiled
test-uncompiled: setup ## kernel and system tests in the interpreter, with branch coverage
	@echo "== tests, uncompiled"
	NUMBA_DISABLE_JIT=1 $(PYTEST) -q $(PARALLEL) -m "not slow and not alone and not vcan and not jit_only" \
	  --cov --cov-report=term $(KERNEL_TESTS) $(wildcard tests/system)

.PHONY: test-bounds
test-bounds: setup ## kernel tests, compiled with index checks
	@echo "== tests, bounds-checked"
	NUMBA_BOUNDSCHECK=1 $(PYTEST) -q $(PARALLEL) -m "not slow and not alone and not vcan and not jit_only" \
	  $(KERNEL_TESTS)

.PHONY: test-slow
test-slow: setup ## long campaigns
	@echo "== slow tests"
	$(PYTEST) -q -n $(WORKERS) --dist load -m "slow and not vcan" tests

.PHONY: vcan
vcan: setup ## the SocketCAN tests: natively, or in a user-mode Linux booted for them
	@echo "== tests on vcan0"
	tests/vcan/run

.PHONY: vcan-slow
vcan-slow: setup ## ten minutes of foreign traffic at full rate
	@echo "== slow tests on vcan0"
	tests/vcan/run $(PYTEST) -q -s -p no:cacheprovider -m "vcan and slow" tests/vcan

.PHONY: latency
latency: setup ## measure the round trip on every bus, vcan in the box if need be, into README
	@rows="$$(mktemp)"
	trap 'rm -f "$$rows"' EXIT
	tests/vcan/run bash -c "$(BIN)/aeroshell bench latency --seconds 20 --bus socketcan:vcan0 --json >'$$rows'"
	$(BIN)/aeroshell bench latency --bus memory --bus unix --rows "$$rows" --readme README.md

# --- cleaning ----------------------------------------------------------------------------------

.PHONY: clean
clean: ## remove .venv, build output and tool caches; runs/ and compiled kernels stay
	@rm -rf $(VENV) build dist ./*.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis \
	  .benchmarks .coverage htmlcov
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.PHONY: clean-kernels
clean-kernels: setup ## remove the compiled kernels of every version of the sources
	@$(BIN)/python -c 'from flight_sw import jit, kernel_cache; \
	  kernel_cache.remove_all(jit.cache_root())'
