# Everything a developer runs. `make demo` on a fresh checkout needs Python 3.11+ and a C++20 compiler.
#
#   make demo                 the marionette learns to walk; results in demo/
#   make test                 the test suite        (ARGS="-k midpoint", SLOW=1, ORACLES=1, WORKERS=0)
#   make bench                the benchmarks        (ARGS=--json)
#   make lint                 everything that is checked without running
#   make variants             the fast tests of what is computed, in the variants of the core that are not the default here
#   make lowest               the fast tests with the lowest versions that pyproject.toml states
#   make sanitize             tests of the core with its memory, its arithmetic and Eigen's assertions checked (slow)
#   make build                compile the C++ that changed   (VARIANTS=v3: only that instruction set)

PYTHON   ?= python3
VENV     ?= .venv
OUT      ?= demo
VARIANTS ?=
ARGS     ?=
ORACLES  ?=
SLOW     ?=
WORKERS  ?= auto
LOWEST   ?= .venv-lowest
# What is quick enough when every access is checked.
SANITIZED ?= tests/conformance tests/derivatives tests/physics tests/optimal
# What is computed by the core, which its other variants run once more.
COMPUTED  ?= tests/conformance tests/derivatives tests/physics tests/optimal tests/api
# MJCF files of other packages, which an oracle compiles too: only their data is wanted, so nothing that they need is installed.
COLLECTIONS := dm-control gymnasium-robotics robosuite
JOBS     ?= $(shell nproc 2>/dev/null || sysctl -n hw.ncpu 2>/dev/null || echo 2)

BIN       := $(VENV)/bin
STAMPS    := $(VENV)/stamps
BUILD_DIR := build/editable
PIP       := $(BIN)/python -m pip --disable-pip-version-check -qq
CXX_FILES := $(wildcard cpp/*.hpp cpp/*.cpp cpp/*/*.hpp cpp/*/*.cpp)
PY_FILES  := $(wildcard src tests benchmarks examples)

export CMAKE_BUILD_PARALLEL_LEVEL ?= $(JOBS)
export CMAKE_GENERATOR ?= Ninja

.DEFAULT_GOAL := help
.PHONY: help setup build demo test bench lint variants lowest sanitize format clean

help:
	@sed -n '3,/^$$/s/^# \{0,1\}//p' $(MAKEFILE_LIST)

# ---- The environment --------------------------------------------------------------------------

# What builds the package, as pyproject.toml states it, and the tools that pip would otherwise fetch
# for every build anew.
$(STAMPS)/build-tools: pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; v >= (3, 11) or sys.exit("leastaction needs Python 3.11 or newer, got %d.%d from \"$(PYTHON)\". Try: make PYTHON=python3.12" % v)'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -c 'import tomllib; print("\n".join(tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"]))' > $(VENV)/build-requires.txt
	$(PIP) install -r $(VENV)/build-requires.txt 'cmake>=3.22' ninja
	@mkdir -p $(STAMPS) && touch $@

# An editable install: Python runs from src/, compiled modules are written beside it.
$(STAMPS)/installed: $(STAMPS)/build-tools pyproject.toml
	PATH="$(abspath $(BIN)):$$PATH" $(PIP) install --no-build-isolation --editable .
	@# The editable finder knows only the files of today; a plain path finds those of tomorrow too.
	@echo "$(abspath src)" > $$(ls $(VENV)/lib/python*/site-packages/_editable_skbc_leastaction.pth)
	@touch $@

# Edited C++ compiles what changed, without pip.
$(STAMPS)/compiled: $(STAMPS)/installed CMakeLists.txt $(CXX_FILES)
	@$(MAKE) --no-print-directory build

$(STAMPS)/extra-%: $(STAMPS)/installed
	@$(BIN)/python -c 'import tomllib; print("\n".join(tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["$*"]))' > $(VENV)/extra-$*.txt
	$(PIP) install -r $(VENV)/extra-$*.txt
	@touch $@

# What the tests use: every extra that is light.
TESTED := $(foreach extra,viz models data c3d test,$(STAMPS)/extra-$(extra))

$(STAMPS)/collections: $(STAMPS)/build-tools
	$(PIP) install --no-deps --target $(VENV)/collections $(COLLECTIONS)
	@touch $@

setup: $(STAMPS)/compiled $(TESTED) $(STAMPS)/extra-dev

build: $(STAMPS)/installed
	@$(BIN)/cmake -S . -B $(BUILD_DIR) $(if $(VARIANTS),-DLEASTACTION_VARIANTS="$(VARIANTS)") > $(BUILD_DIR)/configure.log || { cat $(BUILD_DIR)/configure.log; exit 1; }
	@$(BIN)/cmake --build $(BUILD_DIR)
	@touch $(STAMPS)/compiled

# ---- What it does -----------------------------------------------------------------------------

demo: $(STAMPS)/compiled $(STAMPS)/extra-viz
	$(BIN)/leastaction demo --out $(OUT) $(ARGS)

test: $(STAMPS)/compiled $(TESTED) $(if $(ORACLES),$(STAMPS)/extra-oracles $(STAMPS)/collections)
	$(if $(ORACLES),LEASTACTION_MJCF=$(abspath $(VENV))/collections )$(BIN)/python -m pytest --numprocesses $(WORKERS) --dist loadfile $(if $(SLOW),--slow) $(ARGS)

bench: $(STAMPS)/compiled $(STAMPS)/extra-viz
	@$(BIN)/python -m benchmarks $(ARGS)

lint: $(STAMPS)/compiled $(TESTED) $(STAMPS)/extra-dev
	$(BIN)/ruff check $(PY_FILES)
	$(BIN)/ruff format --check $(PY_FILES)
	$(BIN)/mypy
	$(BIN)/clang-format --dry-run -Werror $(CXX_FILES)
	$(BIN)/lint-imports

variants: $(STAMPS)/compiled $(TESTED) $(if $(ORACLES),$(STAMPS)/extra-oracles)
	for variant in $$($(BIN)/python -c 'from leastaction import _core; print(*[v for v in _core.available_variants() if v != _core.variant])'); do \
	  LEASTACTION_CORE=$$variant $(BIN)/python -m pytest --numprocesses $(WORKERS) --dist loadfile $(if $(ORACLES),,--without-oracles) $(COMPUTED) $(ARGS) || exit 1; \
	done

# An environment of its own beside $(VENV), with the modules that are compiled already. (Matplotlib 3.9 calls what
# pyparsing 3.3 deprecates.)
lowest: $(STAMPS)/compiled
	@test -x $(LOWEST)/bin/python || $(PYTHON) -m venv $(LOWEST)
	@$(BIN)/python -c 'import re, tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; x = p["optional-dependencies"]; print("\n".join(re.sub(">=([^,]*).*", r"==\1", r) for r in ["pyparsing<3.3"] + p["dependencies"] + x["viz"] + x["models"] + x["data"] + x["c3d"] + x["expressions"] + x["test"]))' > $(LOWEST)/lowest.txt
	$(LOWEST)/bin/python -m pip --disable-pip-version-check -qq install -r $(LOWEST)/lowest.txt
	@echo "$(abspath src)" > $$(echo $(LOWEST)/lib/python*/site-packages)/leastaction.pth
	@cp -r $(VENV)/lib/python*/site-packages/leastaction-*.dist-info $(LOWEST)/lib/python*/site-packages/
	@# Old libraries warn of what younger ones beneath them deprecate: no concern of ours.
	$(LOWEST)/bin/python -m pytest --numprocesses $(WORKERS) --dist loadfile -W ignore::DeprecationWarning -W ignore::PendingDeprecationWarning $(ARGS)

# The checked modules go into a copy of the package: those of `make build` stay as they are. (What CasADi loads cannot
# be together with the sanitizer.)
sanitize: $(STAMPS)/installed $(TESTED)
	$(BIN)/cmake -S . -B build/sanitize -DPython_EXECUTABLE=$(abspath $(BIN))/python -DLEASTACTION_SANITIZE=ON -DLEASTACTION_VARIANTS=baseline
	$(BIN)/cmake --build build/sanitize
	rm -rf build/sanitize/package && mkdir build/sanitize/package && cp -r src/leastaction build/sanitize/package/ && rm -f build/sanitize/package/leastaction/_core/*.so
	$(BIN)/cmake --install build/sanitize --prefix build/sanitize/package
	ASAN_OPTIONS=detect_leaks=0 PYTHONPATH=$(abspath build/sanitize/package) \
	  LD_PRELOAD="$$($(CXX) -print-file-name=libasan.so) $$($(CXX) -print-file-name=libstdc++.so)" \
	  $(BIN)/python -m pytest --numprocesses $(WORKERS) --dist loadfile $(SANITIZED) --ignore-glob='*peers*' --ignore-glob='*ipopt*' $(ARGS)

format: $(STAMPS)/extra-dev
	$(BIN)/ruff check --fix --exit-zero $(PY_FILES)
	$(BIN)/ruff format $(PY_FILES)
	$(BIN)/clang-format -i $(CXX_FILES)

clean:
	rm -rf build dist demo $(VENV) .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	rm -f src/leastaction/_core/*.so src/leastaction/_core/*.pyi
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
