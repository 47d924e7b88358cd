# Everything runs from .venv, which the first target that needs it makes.

PYTHON ?= python3
# The compiler that Python was built with need not be here; one that answers to c++ is.
ifeq ($(origin CXX),default)
CXX := c++
endif
export CXX
BIN := .venv/bin
CORE := $(wildcard include/tenodesis/*)
BINDINGS := $(wildcard src/engine/* src/runtime/* src/bindings/*)
C_INTERFACE := $(wildcard src/c/*) examples/controller.c
CPP_TESTS := $(wildcard tests/cpp/*)
TIDY := -std=c++20 -Iinclude -Isrc -Iexamples -fno-math-errno
CPP_FILES := $(CORE) $(C_INTERFACE) $(filter %.cpp %.hpp,$(BINDINGS) $(CPP_TESTS) $(wildcard firmware/*))

.PHONY: demo build test test-cpp test-python firmware bench lint format docs lock clean

demo: build
	$(BIN)/tenodesis bench
	@echo "Open $(CURDIR)/out/report.html"
	@echo "Move the instrument yourself, in the browser: $(BIN)/tenodesis console"

build: .venv/.built

.venv/.deps: requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --no-compile --require-hashes -r requirements.lock
	@touch $@

.venv/.built: .venv/.deps $(CORE) $(BINDINGS) CMakeLists.txt pyproject.toml
	$(BIN)/pip install --quiet --no-build-isolation --no-deps --editable .
	@touch $@

test: test-cpp test-python

test-cpp: .venv/.deps
	$(BIN)/cmake -S . -B build/cpp -G Ninja -DCMAKE_MAKE_PROGRAM=$(CURDIR)/$(BIN)/ninja > /dev/null
	$(BIN)/cmake --build build/cpp
	$(BIN)/ctest --test-dir build/cpp --output-on-failure

test-python: build
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder

# The controller on a microcontroller; says which Debian packages it needs.
firmware: build
	$(MAKE) -C firmware run

bench: build
	$(BIN)/python benchmarks/accuracy.py
	$(BIN)/python benchmarks/statics.py
	$(BIN)/python benchmarks/twin.py
	$(BIN)/python benchmarks/control.py
	$(BIN)/python benchmarks/faults.py
	$(BIN)/python benchmarks/scaling.py
	$(BIN)/python benchmarks/identification.py
	$(BIN)/python benchmarks/live.py

lint: build
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/clang-format --dry-run -Werror $(CPP_FILES)
	flags="$$($(BIN)/python -c 'import nanobind, sysconfig; print("-isystem", nanobind.include_dir(), "-isystem", sysconfig.get_paths()["include"])')"; \
	  printf '%s\n' $(wildcard src/bindings/*.cpp) $(filter tests/cpp/test_%.cpp,$(CPP_TESTS)) | \
	  xargs -P 2 -I {} $(BIN)/clang-tidy --quiet {} -- $(TIDY) $$flags
	$(BIN)/clang-tidy --quiet src/c/tenodesis.cpp tests/cpp/fuzz_c_interface.cpp -- $(TIDY)

format: build
	$(BIN)/ruff check --fix --quiet .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(CPP_FILES)

# What is generated rather than written: the tables in docs/, the editor schema, the typed stub of the C++ module, the
# example's controller.
docs: build
	$(BIN)/tenodesis export controller scaled-up --own-clock --overwrite --out examples/scaled_up.h
	$(BIN)/python docs/generate.py

lock: .venv/.deps
	$(BIN)/pip install --quiet uv
	$(BIN)/uv pip compile pyproject.toml --quiet --extra cluster --extra tables --extra verify --group dev --generate-hashes --no-emit-index-url \
	  --universal --python-version 3.11 --custom-compile-command "make lock" -o requirements.lock

clean:
	rm -rf .venv build out
