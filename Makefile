# Everything runs from .venv, which the first target that needs it makes.

PYTHON ?= python3
# The compiler that Python was built with need not be here; one that answers to c++ is.
ifeq ($(origin CXX),default)
CXX := c++
endif
export CXX
# Hundreds of processes of Python start here: each would compile again whatever it imports.
unexport PYTHONDONTWRITEBYTECODE
BIN := .venv/bin
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist loadfile --no-loadscope-reorder
CORE := $(wildcard include/tenodesis/*)
EXTENSION := $(wildcard src/bindings/* src/engine/* src/runtime/*)
CPP_TESTS := $(wildcard tests/cpp/*)
TIDY := -std=c++20 -Iinclude -Isrc -Iexamples -fno-math-errno -DTENODESIS_FEW_SIZES
# They compile the templates of src/c/joints.cpp and src/bindings/twin.cpp again, for other sizes. The static analyzer
# reads these templates there.
AGAIN := $(patsubst %,src/bindings/%.cpp,tendon_chain chain_twin chain_twins joint_control)
# What has the sizes of an exported header.
SIZED := src/c/joints.cpp tests/cpp/test_joints_interface.cpp
CPP_FILES := $(filter %.h %.hpp %.cpp,$(CORE) $(EXTENSION) $(CPP_TESTS) $(wildcard src/c/* firmware/*)) \
  examples/controller.c $(wildcard tests/consumers/*.c*)
# Ninja takes no jobs from make --jobs.
OWN_JOBS := MAKEFLAGS=
CROSS_PYTHON ?= 3.13
TOOL := $(BIN)/uv run --quiet --no-project --python $(BIN)/python --with-requirements packaging/requirements.lock
LOCK := $(BIN)/uv pip compile --quiet --generate-hashes --no-emit-index-url --universal \
  --python-version 3.11 --custom-compile-command "make lock"
SCHEMAS := src/tenodesis/instruments/instrument.schema.json src/tenodesis/catalogue/catalogue.schema.json

.PHONY: help demo build test test-all test-cpp firmware bench lint format docs site wheel cross audit lock clean

help: ## Say what each target does
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | awk -F '\t' '{printf "  make %-10s %s\n", $$1, $$2}'

demo: build ## Install into .venv, build, and run the bench: out/report.html
	$(BIN)/tenodesis bench
	@echo "Open $(CURDIR)/out/report.html"
	@echo "Move the instrument yourself, in the browser: $(BIN)/tenodesis console"

build: .venv/.built $(SCHEMAS) ## Install into .venv and build

.venv/.deps: requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --no-compile --require-hashes -r requirements.lock
	@touch $@

.venv/.built: .venv/.deps $(CORE) $(EXTENSION) CMakeLists.txt pyproject.toml
	$(OWN_JOBS) $(BIN)/pip install --quiet --no-build-isolation --no-deps --editable .
	@touch $@

# For editors, which complete and check TOML files by them.
src/tenodesis/instruments/instrument.schema.json: .venv/.built $(wildcard src/tenodesis/instrument/*.py) src/tenodesis/units.py
	$(BIN)/tenodesis schema instrument > $@
src/tenodesis/catalogue/catalogue.schema.json: .venv/.built $(wildcard src/tenodesis/scaling/*.py) src/tenodesis/units.py
	$(BIN)/tenodesis schema catalogue > $@

# Matrices are small: threads of linear algebra would mostly wait for each other, and take the cores from other tests.
test test-all site: export OPENBLAS_NUM_THREADS ?= 1

test: test-cpp build ## Run what is run after each change: minutes
	$(PYTEST)

test-all: test-cpp build ## Run every test: also slow ones, processes and browsers, measured data where it is there
	$(PYTEST) -m ""

test-cpp: .venv/.deps ## Build and run the tests of the C++ core alone
	$(BIN)/cmake -S . -B build/cpp -G Ninja -DCMAKE_MAKE_PROGRAM=$(CURDIR)/$(BIN)/ninja > /dev/null
	$(OWN_JOBS) $(BIN)/cmake --build build/cpp
	$(BIN)/ctest --test-dir build/cpp --output-on-failure --parallel $$(nproc)

firmware: build ## Build the controller for a Cortex-M4F and run it in QEMU; names the Debian packages it needs
	$(MAKE) -C firmware run

bench: build ## Run the benchmarks, each against a named peer, and the studies of the law
	for name in startup statics twin backbones environments control scaling identification live; do \
	  $(BIN)/python benchmarks/$$name.py || exit; done
	for name in homing harm changes dither tip_sensor tremor tissue plants information faults coverage; do \
	  $(BIN)/python studies/$$name.py || exit; done
	$(BIN)/tenodesis vertices --overwrite

lint: build ## Check style, types, layers and C++
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/clang-format --dry-run -Werror $(CPP_FILES)
	flags="$$($(BIN)/python -c 'import nanobind, sysconfig; print("-isystem", nanobind.include_dir(), "-isystem", sysconfig.get_paths()["include"])')"; \
	  { printf '%s --checks=-clang-analyzer-*\n' $(AGAIN); \
	    printf '%s\n' $(filter-out %_avx2.cpp %_avx512.cpp $(SIZED) $(AGAIN),$(wildcard src/bindings/*.cpp src/c/*.cpp tests/cpp/test_*.cpp tests/cpp/fuzz_*.cpp)); } | \
	  xargs -P $$(nproc) -L 1 sh -c '$(BIN)/clang-tidy --quiet "$$@" -- $(TIDY) '"$$flags" tidy
	$(BIN)/clang-tidy --quiet $(SIZED) -- $(TIDY) -include examples/needle_driver.h

format: build ## Format Python and C++
	$(BIN)/ruff check --fix --quiet .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(CPP_FILES)

docs: build ## Regenerate what is generated: pictures, the report's figures in docs/results.json, the example's controller
	$(BIN)/tenodesis export controller scaled-up --homed --own-clock --overwrite --out examples/scaled_up.h
	$(BIN)/tenodesis export controller needle-driver --overwrite --out examples/needle_driver.h
	$(BIN)/python docs/generate.py

site: build ## Build the documentation site, its tutorials executed, and check its links: build/site
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet --fresh-env --jobs 8 \
	  --doctree-dir build/doctrees docs build/site
	$(BIN)/python docs/check_site.py build/site

wheel: build ## Build the wheel for this Python into dist/, and check it
	$(BIN)/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist .
	$(MAKE) audit

cross: .venv/.deps ## Build the wheels for every system into dist/, and check them; CROSS_PYTHON=3.12 or newer
	$(BIN)/uv run --quiet --no-project --python $(CROSS_PYTHON) --with-requirements packaging/requirements.lock \
	  packaging/cross_build.py
	$(MAKE) audit

audit: .venv/.deps
	$(TOOL) twine check --strict dist/*.whl
	$(TOOL) check-wheel-contents dist/*.whl
	for wheel in $(wildcard dist/*-linux*.whl dist/*-manylinux*.whl); do $(TOOL) auditwheel show $$wheel || exit; done
	for wheel in $(wildcard dist/*abi3*.whl); do $(TOOL) abi3audit --strict $$wheel || exit; done

lock: .venv/.deps ## Pin all dependencies anew
	$(LOCK) pyproject.toml --extra all --extra gym --group dev --group docs -o requirements.lock
	$(LOCK) --group package -o packaging/requirements.lock

clean: ## Remove .venv, build and out
	rm -rf .venv build dist out
