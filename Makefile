# make reproduce · make test · make check · make docs : each sets up what it needs in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= reproduce

.PHONY: help setup reproduce quick test check format docs clean

help:
	@echo "make reproduce   run the whole paper and write $(OUT)/report.html"
	@echo "make quick       the same, shortened (figures are marked as such)"
	@echo "make test        run the tests"
	@echo "make check       formatter, linter, types, import contracts"
	@echo "make docs        redraw the drawings of docs/"

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml
	@command -v $(PYTHON) >/dev/null || { echo "treadline: $(PYTHON) not found; install Python 3.11 or newer" >&2; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "treadline: $(PYTHON) is older than 3.11; call make PYTHON=python3.12" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[dev]"
	@touch $@

reproduce: setup
	$(BIN)/treadline reproduce --out $(OUT)

quick: setup
	$(BIN)/treadline reproduce --quick --out $(OUT)

test: setup
	$(BIN)/python -m pytest -n 2 --dist loadfile

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: setup
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: setup
	$(BIN)/python -m treadline.report.drawings docs/drawings

clean:
	rm -rf $(VENV) reproduce runs .mypy_cache .ruff_cache .pytest_cache
