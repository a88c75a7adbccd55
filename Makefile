# Everything runs in .venv, which `make setup` builds from requirements.lock.
# `make help` lists the targets; `make test`, `make test-slow-share` and `make vcan` are the whole of
# CI.

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
# One slow test may take an hour, on a busy machine longer.
SLOW := -o faulthandler_timeout=7200

# Where kernels are exercised one by one; whole flights live in tests/system and tests/replay.
KERNEL_TESTS = $(wildcard tests/flight_sw tests/sim_harness)
CODE = flight_sw sim_harness tools tests $(wildcard benchmarks)

# Mathematics as another x86-64 processor does them: the C library's without FMA and AVX, linear
# algebra by kernels of 2004. tests/rules/test_other_processor.py shows that they differ.
OTHER_PROCESSOR := GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX OPENBLAS_CORETYPE=Prescott
NUMERICAL_TESTS = $(wildcard tests/flight_sw tests/replay tests/tools/test_gains_*.py \
  tests/sim_harness/test_a*.py tests/sim_harness/test_closed_forms.py tests/sim_harness/test_gravity.py \
  tests/sim_harness/test_motion.py tests/sim_harness/test_vehicle.py \
  tests/system/test_bits.py tests/system/test_tables.py tests/system/test_mars.py \
  tests/system/test_noisy_navigation.py tests/system/test_other_vehicle.py)
ORDER ?= 11

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
	@echo "== load images"
	for design in gains/*/design.toml; do
	  $(BIN)/aeroshell gains "$$(basename "$$(dirname "$$design")")" --check
	done

.PHONY: bench
bench: setup ## measure speed; run it on an otherwise idle machine
	@$(PYTEST) benchmarks -o addopts= -o python_files='bench_*.py test_*.py' -p no:xdist -s -q

# --- checking ----------------------------------------------------------------------------------

.PHONY: test
test: lint types spelling gains-check test-compiled test-uncompiled test-bounds test-processor ## all checks but the slow ones

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

.PHONY: test-processor
test-processor: setup ## numerical tests in another order, on what computes as another processor does
	@echo "== tests, as on another processor"
	env $(OTHER_PROCESSOR) $(PYTEST) -q $(PARALLEL) --order-seed $(ORDER) \
	  -m "not slow and not alone and not vcan" $(NUMERICAL_TESTS)

.PHONY: test-slow-share
test-slow-share: setup ## the share of the slow tests that CI runs
	@echo "== slow tests, a share"
	$(PYTEST) -q -n $(WORKERS) --dist load $(SLOW) -m "share and not alone and not vcan" tests
	$(PYTEST) -q -p no:xdist $(SLOW) -m "share and alone and not vcan" tests

.PHONY: test-slow
test-slow: setup ## long campaigns
	@echo "== slow tests"
	$(PYTEST) -q -n $(WORKERS) --dist load $(SLOW) -m "slow and not alone and not vcan" tests
	$(PYTEST) -q -p no:xdist $(SLOW) -m "slow and alone and not vcan" tests

.PHONY: vcan
vcan: setup ## the SocketCAN tests: natively, or in a user-mode Linux booted for them
	@echo "== tests on vcan0"
	exec tests/vcan/run  # no shell between: who is ended with make is its child

.PHONY: vcan-slow
vcan-slow: setup ## ten minutes of foreign traffic at full rate
	@echo "== slow tests on vcan0"
	exec tests/vcan/run $(PYTEST) -q -s -p no:cacheprovider $(SLOW) -m "vcan and slow" tests/vcan

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
	@$(BIN)/python -c 'from flight_sw.runtime import jit, kernel_cache; \
	  kernel_cache.remove_all(jit.cache_root())'
