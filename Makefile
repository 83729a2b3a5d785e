# Every target works on a fresh clone with python3 (3.11 or newer) alone: it makes .venv first.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
# Lists what pyproject.toml says that the package needs, and each of the extras that follow.
NEEDS := $(BIN)/python -c 'import sys, tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
	extras = [project["optional-dependencies"][name] for name in sys.argv[1:]]; \
	print(*[need for list in (project["dependencies"], *extras) for need in list if "pdecodec[" not in need], sep="\n")'
CORE := $(shell find core -name '*.hpp' -o -name '*.cpp' -o -name '*.h' -o -name CMakeLists.txt)
INSTALL := $(PIP) --no-build-isolation --no-deps
# The system's C++ compiler; where there is none, the one in the package ziglang, through two scripts. Its C++ library is
# another than that of the package nanobind-backend: nanobind is linked in then.
ifeq ($(shell command -v c++),)
COMPILER := .venv/compiler
INSTALL := CC=$(CURDIR)/$(BIN)/zig-cc CXX=$(CURDIR)/$(BIN)/zig-c++ $(INSTALL) --config-settings wheel.py-api=
endif
BUILD_TOOLS := 'scikit-build-core>=1.0' 'nanobind>=3' \
	$(if $(shell command -v cmake),,'cmake>=3.20') $(if $(shell command -v ninja),,ninja)
INSTALLED := .venv/installed
READY := .venv/ready

.PHONY: demo test test-all test-plugins long browser lint types sanitize races fuzz fuzz-readers exactness bench growth bench-rd figures reproduce stability paper interop blender-extension dist amalgamation docs site vectors wasm clean

demo: $(INSTALLED)
	$(BIN)/pdecodec demo -o out

# Checks run beside the sanitizers' build, which does not keep two processors busy. Tests start many processes: where
# Python must not write byte code, each of them would compile all that it imports.
test:
	$(MAKE) --no-print-directory --jobs 2 MUTANTS=1000 lint types browser sanitize
	env -u PYTHONDONTWRITEBYTECODE $(BIN)/python -m pytest -n auto --dist loadfile --durations=20

# All of it: other builds of the core give the same results, more damaged files, and the tests that take minutes.
test-all: test exactness races
	$(MAKE) --no-print-directory MUTANTS=20000 sanitize
	$(MAKE) --no-print-directory long

# Tests that take minutes and print what they measured: kills, full disks, threads, the worst files of each section.
long: $(READY)
	$(BIN)/python -m pytest -m long -n 0

# Plug-ins in the programs that they are for, as far as those are installed for PLUGINS_PYTHON or in the path. Another
# PLUGINS_PYTHON than .venv's has pytest, hypothesis and this folder, installed with --editable.
PLUGINS_PYTHON ?= $(BIN)/python
test-plugins: $(if $(filter $(BIN)/python,$(PLUGINS_PYTHON)),$(READY))
	PXR_PLUGINPATH_NAME=$(CURDIR)/build/usd $(PLUGINS_PYTHON) -m pytest tests/plugins

# The decoder under the sanitizers: misuse of the C interface, all vectors and MUTANTS damaged ones; with the system's
# compiler alone.
MUTANTS ?= 4000
SANITIZE := PATH="$(CURDIR)/$(BIN):$$PATH" cmake
ifeq ($(COMPILER),)
sanitize: .venv/tools
	$(SANITIZE) -S core -B build/sanitize -DPDEANIM_SANITIZE=ON -DPDEANIM_LIBRARY=OFF -DCMAKE_BUILD_TYPE=Debug
	$(SANITIZE) --build build/sanitize --parallel 2 --target mutants misuse
	$(BIN)/python -m spec.vector_files build/vectors
	build/sanitize/misuse $(addprefix build/vectors/accept/,polygons_attributes.pdeanim runs.pdeanim fields.pdeanim)
	build/sanitize/mutants $(MUTANTS) build/vectors/*/*.pdeanim

# Threads that share animations through the C interface, under ThreadSanitizer.
CALLS ?= 6000
races: .venv/tools
	$(SANITIZE) -S core -B build/races -DPDEANIM_SANITIZE=ON -DPDEANIM_SANITIZERS=thread -DPDEANIM_LIBRARY=OFF \
		-DCMAKE_BUILD_TYPE=Debug
	$(SANITIZE) --build build/races --parallel 2 --target races
	$(BIN)/python -m spec.vector_files build/vectors
	build/races/races $(CALLS) $(addprefix build/vectors/accept/,groups.pdeanim polygons_attributes.pdeanim \
		raw_vertices.pdeanim runs.pdeanim many_patches.pdeanim)
else
sanitize races:
	@echo 'no sanitizers: there is no C++ compiler but that of a package'
endif

# libFuzzer for so many MINUTES on each of TARGETS, from the vectors on; needs clang. What it finds is left in build/.
TARGETS ?= fuzz_open fuzz_interface
MINUTES ?= 5
CLANG ?= $(shell command -v clang++ || ls /usr/bin/clang++-* | sort -V | tail -1)
fuzz: .venv/tools
	$(SANITIZE) -S core -B build/fuzz -DPDEANIM_FUZZ=ON -DPDEANIM_LIBRARY=OFF -DCMAKE_CXX_COMPILER=$(CLANG)
	$(SANITIZE) --build build/fuzz --parallel 2 --target $(TARGETS)
	$(BIN)/python -m spec.vector_files build/vectors
	for target in $(TARGETS); do mkdir -p build/corpus/$$target && build/fuzz/$$target -max_total_time=$$(($(MINUTES) * 60)) \
		-timeout=20 -rss_limit_mb=2048 -print_final_stats=1 -artifact_prefix=build/$$target- build/corpus/$$target \
		build/vectors/accept build/vectors/reject || exit 1; done

# Readers of other formats for so many MINUTES each, or those that READERS names. What it finds is left in build/.
READERS ?=
fuzz-readers: $(READY)
	$(BIN)/python -m tests.slow.fuzz.readers $(MINUTES) $(READERS)

# Builds by several compilers, settings and processors decode the vectors alike. Those that are not here are skipped.
exactness: $(INSTALLED)
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m core.tests.exactness $(BUILDS)

# Khronos' glTF validator and three.js, for tests that skip without them: where there is no npm, or no network.
browser:
	-command -v npm >/dev/null && npm install --silent --no-audit --no-fund --no-package-lock --prefix tests/browser

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run -Werror $(filter-out core/CMakeLists.txt,$(CORE)) examples/c/*.c core/tests/*.c plugins/usd/src/*

# mypy needs the folders nested in one package, as they are installed: links stand in for copies.
types: $(READY)
	rm -rf build/types
	$(BIN)/python -c 'import pathlib, tomllib; \
		packages = tomllib.load(open("pyproject.toml", "rb"))["tool"]["scikit-build"]["wheel"]["packages"]; \
		links = {pathlib.Path("build/types", target, entry.name): entry.resolve() \
			for target, folder in packages.items() for entry in pathlib.Path(folder).iterdir()}; \
		[(link.parent.mkdir(parents=True, exist_ok=True), link.symlink_to(entry)) for link, entry in links.items()]'
	cd build/types && ../../$(BIN)/mypy --config-file ../../pyproject.toml -p pdecodec

bench: $(INSTALLED)
	$(BIN)/python -m pdecodec.research.bench

# How time and memory grow with frames and vertices; minutes.
growth: $(INSTALLED)
	$(BIN)/python -m pdecodec.research.growth

# make bench-rd SEQUENCES="a.npz b.npz" OPTIONS="--tolerance 1e-3 --no-baselines"; without them a rope is simulated.
bench-rd: $(READY)
	mkdir -p out
	$(if $(SEQUENCES),,$(BIN)/pdecodec simulate cube-rope -o out/rope.npz --frames 60 --overwrite)
	$(BIN)/pdecodec report $(or $(SEQUENCES),out/rope.npz) -o out/bench-rd $(OPTIONS)

# make figures DATA=folder: the corpus report, and its tables and charts in docs/.
figures: $(READY)
	$(NEEDS) baselines | $(PIP) --requirement /dev/stdin
	$(BIN)/pdecodec report $(DATA) -o out/corpus
	$(BIN)/python docs/make_figures.py out/corpus docs/results.md

# The paper reproduced and judged, and the atlas of stability; docs/paper keeps what the README quotes.
reproduce: $(INSTALLED)
	$(BIN)/pdecodec reproduce -o out/paper

stability: $(INSTALLED)
	$(BIN)/pdecodec stability -o out/stability

paper: reproduce stability
	$(BIN)/python docs/make_paper.py out/paper out/stability docs/paper

# The source, and from it the wheel for this kind of machine.
dist: .venv/tools
	$(PIP) 'build>=1.2'
	$(BIN)/python -m build --no-isolation --outdir dist

# The source, and wheels for Linux on x86-64 and arm64 that other systems load, too. Each needs GCC for
# its processor (g++-aarch64-linux-gnu, or g++-x86-64-linux-gnu); one without it is skipped.
.PHONY: wheels
wheels: .venv/tools
	$(PIP) 'ziglang==0.17.1' 'auditwheel>=6.4' 'build>=1.2'
	$(BIN)/python -m build --sdist --no-isolation --outdir dist
	$(BIN)/python -m core.wheels dist

# Installs the wheels of dist/ where nothing else is installed, and uses them: in each Python of the path, and in those that
# PYTHONS names, each a quoted command; docs/platforms.md has some for emulators.
.PHONY: test-wheels
test-wheels: $(READY)
	$(BIN)/python -m tests.installed.wheels dist $(PYTHONS)

# Everything that a release publishes, into dist/, which must not hold files of another version; docs/install.md lists and
# explains it. A part whose tools are not here is named and left out. What is ours has the same bytes every time. PACKAGES is
# the target that makes the Python packages; if it is empty, those in dist/ are taken.
PACKAGES ?= wheels
.PHONY: release test-release
release: export SOURCE_DATE_EPOCH ?= $(shell git log -1 --format=%ct 2>/dev/null || echo 315532800)
release: .venv/tools
	$(BIN)/python docs/make_release.py notes >/dev/null
	mkdir -p dist
	$(if $(PACKAGES),$(MAKE) --no-print-directory $(PACKAGES))
	$(PIP) 'typst~=0.15' 'pypandoc-binary~=1.17'
	for wheel in dist/pdecodec-*.whl; do $(MAKE) --no-print-directory blender-extension WHEEL=$$wheel || exit 1; done
	$(if $(shell command -v npm),npm pack --silent --pack-destination dist ./player,@echo 'no npm package: npm is not here')
	if echo '#include <zstd.h>' | c++ -E -x c++ - >/dev/null 2>&1; \
		then $(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist ./plugins/usd; \
		else echo 'no USD plug-in: a C++ compiler and the headers of Zstandard (libzstd-dev) are not here'; fi
	$(BIN)/python docs/make_pdf.py dist/pdeanim-format-1.0.pdf
	$(BIN)/python docs/make_release.py pack dist

# Installs and uses each file of dist/ in an environment of its own, by the lines of docs/install.md. PDECODEC_BLENDER names
# a Python that has the package bpy. What cannot run here is skipped by name.
test-release: $(READY)
	$(BIN)/python -m pytest -n 0 tests/installed/release.py

# The decoder as one C++ file and a header, to be compiled into another program.
amalgamation:
	$(PYTHON) -m core.amalgamation dist/amalgamation

docs: $(INSTALLED)
	$(BIN)/python docs/make_cli.py docs/cli.md
	$(BIN)/python docs/make_formats.py docs/formats.md
	$(BIN)/python docs/make_encoder.py docs/encoder.md

# The documentation as a site; a warning of Sphinx, a broken link or a file of another host is an error.
site: $(INSTALLED)
	$(NEEDS) docs | $(PIP) --requirement /dev/stdin
	$(BIN)/python docs/make_site.py build/site

# The decoder as WebAssembly, for the player; the test of its sources says when.
wasm: $(INSTALLED)
	$(PIP) 'ziglang==0.17.1'
	npm install --silent --no-audit --no-fund --no-package-lock --prefix build/binaryen binaryen@132.0.0
	$(BIN)/python core/bindings/wasm/build.py player/pdeanim.wasm

# What other programs see of real files: the shared data's folder is named by PDECODEC_DATA.
interop: $(READY) browser
	$(BIN)/python -m tests.interop.table docs/interop.md

# The extension with its wheels for this kind of machine, or that of the wheel WHEEL, for the Python of Blender 4.2 to 5.0.
TAGS = $(filter-out linux_%,$(subst ., ,$(lastword $(subst -, ,$(basename $(WHEEL))))))
blender-extension: $(if $(WHEEL),.venv/tools,$(READY))
	rm -rf build/blender && mkdir -p build/blender
	$(if $(WHEEL),cp $(WHEEL),$(BIN)/python -m build --wheel --no-isolation --outdir) build/blender
	$(BIN)/python -m pip download --quiet --no-deps --only-binary :all: --python-version 3.11 $(addprefix --platform ,$(TAGS)) \
		--dest build/blender 'nanobind-backend<2'
	$(BIN)/python plugins/blender/build.py dist build/blender/*.whl

# The file format plug-in for the usd-core of PLUGINS_PYTHON; plugins/usd/README.md says what it needs.
.PHONY: usd-plugin
usd-plugin:
	cmake -S plugins/usd -B build/usd -DPython_EXECUTABLE=$(abspath $(PLUGINS_PYTHON))
	cmake --build build/usd --target pdeanim_usd

vectors: $(INSTALLED)
	$(BIN)/python -m spec.make_vectors

# Without --no-compile, pip compiles every module of every dependency: as long again as the whole installation.
.venv/tools:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "pdecodec needs Python 3.11 or newer")'
	$(PYTHON) -m venv .venv
	$(PIP) $(BUILD_TOOLS)
	touch $@

.venv/compiler: .venv/tools
	@echo 'there is no C++ compiler here: taking the package ziglang (400 MB); its first build takes minutes'
	$(PIP) 'ziglang>=0.15'
	for name in cc c++; do printf '#!/bin/sh\nexec "%s" -m ziglang %s "$$@"\n' "$(CURDIR)/$(BIN)/python" $$name > $(BIN)/zig-$$name; done
	chmod +x $(BIN)/zig-cc $(BIN)/zig-c++
	touch $@

# What the package needs comes while its core is compiled; what draws charts and pictures, too.
$(INSTALLED): pyproject.toml $(CORE) .venv/tools $(COMPILER)
	$(NEEDS) report | $(PIP) --requirement /dev/stdin & $(INSTALL) --editable . && wait $$!
	touch $(INSTALLED)

$(READY): $(INSTALLED)
	$(NEEDS) abc usd gltf research dev | $(PIP) --requirement /dev/stdin
	touch $(READY)

clean:
	rm -rf .venv build dist out
