# Two commands: `make demo` and `make test`. Each sets up what it needs in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
SOURCES := pneugantry pyfmi_runner modelica_fmu controllers benchmarks examples

.PHONY: demo test test-slow lint docs wheel lock clean
.DELETE_ON_ERROR:

demo: $(READY)
	$(BIN)/pneugantry demo

test: lint ## on two to four cores; tests/conftest.py says what stays together
	$(BIN)/python -m compileall -q $(SOURCES) # else each process does, where PYTHONDONTWRITEBYTECODE is set
	$(BIN)/python -m pytest -m "not slow" --numprocesses logical --maxprocesses 4 --dist loadgroup

test-slow: lint
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(READY) ## the site, into site/; a broken link fails it
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

wheel: $(READY) ## the wheel in a clean environment outside the checkout
	$(BIN)/python -m benchmarks.clean_install

$(READY): pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --requirement requirements.lock
	@command -v $${CC:-cc} >/dev/null 2>&1 || { echo "no C compiler found: installing ziglang (411 MB)"; $(BIN)/python -m pip install --quiet "ziglang>=0.13"; }
	$(BIN)/python -m pip install --quiet --no-deps --editable .
	@touch $@

lock: ## renew requirements.lock from pyproject.toml
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --extra dev --no-emit-index-url --no-header --no-annotate pyproject.toml -o requirements.lock

clean:
	rm -rf out fmus/*.fmu fmus/*.json .pytest_cache .mypy_cache .ruff_cache
