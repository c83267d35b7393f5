# make rehearse: install into .venv and run the whole spoon task, with pictures where OpenGL can be had.

PYTHON ?= python3
# An interpreter that is named has an environment of its own: make test PYTHON=python3.12
ifeq ($(origin PYTHON),file)
VENV ?= .venv
else
VENV ?= .venv-$(notdir $(PYTHON))
endif
BIN := $(VENV)/bin
OUT ?= out/spoon
EXTRAS := test,human,record,learn,docs,ros,lerobot,slurm,calibrate
GL_PACKAGES := libegl1 libgl1
APT_LINE := apt-get install -y --no-install-recommends $(GL_PACKAGES)
# True when both libraries can be loaded; asked of the dynamic linker, as PyOpenGL does.
HAS_GL := $(PYTHON) -c "import ctypes; [ctypes.CDLL(name) for name in ('libEGL.so.1', 'libGL.so.1')]" 2>/dev/null

VERSION := "import sys; print('%d.%d' % sys.version_info[:2])"

.PHONY: rehearse test test-long test-slow newest versions lint docs site constraints meshes clean gl interpreter
.DEFAULT_GOAL := rehearse

rehearse: $(VENV)/.run gl
	@# Without the libraries MuJoCo can be imported only when told to leave OpenGL alone.
	@if $(HAS_GL); then video=; else video=--no-video; export MUJOCO_GL=disable; fi; \
	set -x; $(BIN)/robosim rehearse spoon --out $(OUT) $$video

# The tests of a file stay in one process, which has its fixtures and kernels then; how long each took is kept. Files come in
# their own order: by number of tests, the longest one would come last, with one process idle.
PYTEST = $(BIN)/python -m pytest -n 2 --dist loadscope --no-loadscope-reorder --durations 30 --durations-min 3 --junitxml .cache/$@.xml

test: $(VENV)/.test
	$(PYTEST) -m "not long and not slow"

test-long: $(VENV)/.test
	$(PYTEST) -m "long and not slow"

test-slow: $(VENV)/.test
	$(PYTEST) -m slow

# A part of the tests with the newest releases that pyproject.toml allows, in an environment of its own: whether a bound or
# a constraint can be raised. make newest PYTHON=python3.13; MUJOCO names a release in their place, as 4.*: pip then says
# where pyproject.toml does not allow it. One job for each interpreter and for MuJoCo's old and new releases:
# make versions, or make newest-python3.12, make newest-mujoco-4
NEWEST := $(VENV)-newest
newest:
	$(PYTHON) -m venv $(NEWEST)
	$(NEWEST)/bin/python -m pip install -q --upgrade -e ".[test,learn]"
	[ -z "$(MUJOCO)" ] || { $(NEWEST)/bin/python -m pip uninstall -q -y mujoco mujoco-core mujoco-studio; \
		$(NEWEST)/bin/python -m pip install -q "mujoco==$(MUJOCO)"; }
	$(NEWEST)/bin/python -m pip list | grep -i -E "^(mujoco|gymnasium|stable_baselines3|numpy|pin|scipy|torch|trimesh) "
	$(NEWEST)/bin/python -m pytest -m "not slow" $(addprefix tests/robosim/,coupling robot scene envs rendering)

VERSIONS := newest-python3.11 newest-python3.12 newest-python3.13 newest-mujoco-3.17 newest-mujoco-4
versions: $(VERSIONS)

newest-python%:
	$(MAKE) newest PYTHON=python$*

newest-mujoco-%:
	$(MAKE) newest NEWEST=$(VENV)-mujoco-$* MUJOCO="$*.*"

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/pyright --pythonpath $(BIN)/python

# Runs every code block of the pages, the slow ones too, then builds the site.
docs: $(VENV)/.docs
	$(BIN)/python -m pytest -n 2 tests/docs tests/test_readme.py
	@$(MAKE) --no-print-directory site

# Builds the site into docs/_build/html; a warning is an error.
site: $(VENV)/.docs
	$(BIN)/python -m sphinx -b html -W --keep-going docs docs/_build/html
	@echo "docs/_build/html/index.html"

# What pip would install for all extras; an error if the constraints cannot be met. Nothing is installed.
constraints: $(VENV)/bin/python
	$(BIN)/python -m pip install --dry-run --ignore-installed --only-binary=:all: -c constraints.txt ".[$(EXTRAS)]"

meshes: $(VENV)/.test
	$(BIN)/python models/make_meshes.py
	for script in models/*/*/make_meshes.py; do $(BIN)/python $$script || exit 1; done

clean:
	rm -rf .venv .venv-* .cache build dist out docs/_build docs/_generated *.egg-info .pytest_cache .ruff_cache

gl:
	@if $(HAS_GL); then exit 0; fi; \
	sudo=; if [ "$$(id -u)" != 0 ]; then sudo="sudo -n"; fi; \
	if command -v apt-get >/dev/null && $$sudo true 2>/dev/null; then \
		$$sudo apt-get update -qq; $$sudo $(APT_LINE) || true; \
	fi; \
	if ! $(HAS_GL); then \
		echo "No headless OpenGL: no video will be made. For a video, run: sudo $(APT_LINE)"; \
	fi

$(VENV)/bin/python: | interpreter
	$(PYTHON) -m venv $(VENV)

# An environment of another version is refused; it is neither used nor removed.
interpreter:
	@wanted=$$($(PYTHON) -c $(VERSION)) || exit 1; \
	[ ! -x $(BIN)/python ] || [ "$$wanted" = "$$($(BIN)/python -c $(VERSION))" ] || { \
		echo "$(VENV) has Python $$($(BIN)/python -c $(VERSION)), and PYTHON = $(PYTHON) is $$wanted;" \
			"accepted: the same version; remove $(VENV), or name another folder: VENV=FOLDER" >&2; exit 1; }

# One stamp per kind of install. The plain one copies the sources, hence its list of prerequisites. The two replace
# each other in the environment, so each removes the other's stamp.
SOURCES := $(shell find robosim mpm policies configs models -type f ! -name '*.pyc' 2>/dev/null)

$(VENV)/.run: $(VENV)/bin/python pyproject.toml constraints.txt $(SOURCES)
	@rm -rf build  # a stale one would put deleted files back into the install
	$(BIN)/python -m pip install -c constraints.txt .
	@rm -f $(VENV)/.test; touch $@

$(VENV)/.test: $(VENV)/bin/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install -c constraints.txt -e ".[test,learn,ros,lerobot,slurm,calibrate]"
	@rm -f $(VENV)/.run; touch $@

$(VENV)/.docs: $(VENV)/.test
	$(BIN)/python -m pip install -c constraints.txt -e ".[test,learn,ros,lerobot,slurm,calibrate,docs]"
	@touch $@
