# Every target works on a fresh clone with python3 (3.11 or newer) alone: it makes .venv first.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready

.PHONY: demo test lint types bench docs vectors clean

demo: $(READY)
	$(BIN)/pdecodec demo -o out

test: lint types
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# mypy sees all three folders only where they lie as they are installed: nested in one package.
types: $(READY)
	rm -rf build
	$(BIN)/python -m pip install --quiet --no-deps --target build/types .
	cd build/types && ../../$(BIN)/mypy --config-file ../../pyproject.toml -p pdecodec

bench: $(READY)
	$(BIN)/python -m pdecodec.experiments.bench

docs: $(READY)
	$(BIN)/python docs/make_cli.py docs/cli.md

vectors: $(READY)
	$(BIN)/python spec/make_vectors.py

# Without --no-compile, pip compiles every module of every dependency: as long again as the whole installation.
$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "pdecodec needs Python 3.11 or newer")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[dev]' 'setuptools>=77'
	touch $(READY)

clean:
	rm -rf .venv build dist out *.egg-info
