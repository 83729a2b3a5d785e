# Every target works on a fresh clone with python3 (3.11 or newer) alone: it makes .venv first.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
INSTALLED := .venv/installed
READY := .venv/ready

.PHONY: demo test browser lint types bench bench-rd figures reproduce stability paper docs vectors clean

demo: $(INSTALLED)
	$(BIN)/pdecodec demo -o out

test: lint types browser
	$(BIN)/python -m pytest

# Khronos' glTF validator and three.js, for tests that skip without them: where there is no npm, or no network.
browser:
	-command -v npm >/dev/null && npm install --silent --no-audit --no-fund --no-package-lock --prefix tests/browser

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# mypy sees all three folders only where they lie as they are installed: nested in one package.
types: $(READY)
	rm -rf build
	$(PIP) --no-deps --target build/types .
	cd build/types && ../../$(BIN)/mypy --config-file ../../pyproject.toml -p pdecodec

bench: $(INSTALLED)
	$(BIN)/python -m pdecodec.experiments.bench

# make bench-rd SEQUENCES="a.npz b.npz" OPTIONS="--tolerance 1e-3 --no-peers"; without them a rope is simulated.
bench-rd: $(READY)
	mkdir -p out
	$(if $(SEQUENCES),,$(BIN)/pdecodec simulate cube-rope -o out/rope.npz --frames 60 --overwrite)
	$(BIN)/pdecodec report $(or $(SEQUENCES),out/rope.npz) -o out/bench-rd $(OPTIONS)

# make figures DATA=folder: the corpus report, and its table in the README.
figures: $(READY)
	$(PIP) --editable '.[peers]'
	$(BIN)/pdecodec report $(DATA) -o out/corpus
	$(BIN)/python docs/make_figures.py out/corpus README.md docs/bytes-against-error.png

# The paper reproduced and judged, and the atlas of stability; docs/paper keeps what the README quotes.
reproduce: $(INSTALLED)
	$(BIN)/pdecodec reproduce -o out/paper

stability: $(INSTALLED)
	$(BIN)/pdecodec stability -o out/stability

paper: reproduce stability
	$(BIN)/python docs/make_paper.py out/paper out/stability docs/paper

docs: $(INSTALLED)
	$(BIN)/python docs/make_cli.py docs/cli.md
	$(BIN)/python docs/make_formats.py docs/formats.md

vectors: $(INSTALLED)
	$(BIN)/python -m spec.make_vectors

# Without --no-compile, pip compiles every module of every dependency: as long again as the whole installation.
$(INSTALLED): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "pdecodec needs Python 3.11 or newer")'
	$(PYTHON) -m venv .venv
	$(PIP) --editable .
	touch $(INSTALLED)

# The build backend comes along for the test that builds a wheel.
$(READY): $(INSTALLED)
	$(PIP) --editable '.[dev]' 'setuptools>=77'
	touch $(READY)

clean:
	rm -rf .venv build dist out *.egg-info
