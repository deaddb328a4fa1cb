# make demo   train with a demonstrator, drive, and write runs/demo/report.html
# make test   run the tests
# make coverage  run the tests and measure what they cover, which takes half as long again
# make check  run the linters and build the documentation; CI runs `make check coverage`
# make fuzz   damaged files against every reader, a minute of each
# make soak   an hour of work with flat memory, beside 100 kills that lose nothing (MINUTES=, KILLS=)
# make docs   serve the documentation at http://127.0.0.1:8000
# make setup  make .venv with everything in it; the others do so by themselves
# make lock   write the versions that are in .venv to constraints.txt, the same with digests for
#             every platform to requirements.lock, and the bill of materials sbom.cdx.json (CycloneDX)
# make audit  ask the package registry for known faults of what requirements.lock names
# make release  build wheel and sdist into dist/, check and try them (PYTHONS="python3.11 ...")
# make clean  remove .venv and caches; runs/ stays

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.complete
TOOLS := $(VENV)/tools
WORKERS ?= 2
MINUTES ?= 60
KILLS ?= 100

export PIP_DISABLE_PIP_VERSION_CHECK := 1

# Tests start many processes: compiled modules are kept, whatever the shell says.
export PYTHONDONTWRITEBYTECODE :=

# Without it, a banner about the theme's successor stands in every log.
export NO_MKDOCS_2_WARNING := 1

.PHONY: demo test coverage check docs fuzz soak setup lock audit release clean

demo: $(STAMP)
	$(BIN)/steersman demo --out runs/demo

# One thread for each test process: WORKERS is what uses the cores.
test: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/pytest -n $(WORKERS) --dist worksteal

coverage: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/pytest -n $(WORKERS) --dist worksteal --cov --cov-report=term

fuzz: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/fuzz.py

soak: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/soak.py --minutes $(MINUTES) --kills $(KILLS)

check: $(STAMP)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/mkdocs build --strict

docs: $(STAMP)
	$(BIN)/mkdocs serve

setup: $(STAMP)

# The stamp is written last: an interrupted installation is taken up again.
$(STAMP): pyproject.toml constraints.txt requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "steersman needs Python 3.11 or newer, and $(PYTHON) is $$($(PYTHON) -V 2>&1 || true);" \
	       "name another with: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "$(PYTHON) cannot make virtual environments; on Debian or Ubuntu:" \
	       "apt-get install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --require-hashes --no-deps -r requirements.lock
	$(BIN)/python -m pip install -c constraints.txt -e '.[train,tune,report,notebook,video,live,bench,logs,lanelet2,minari,ray,carla,docs,dev]'
	touch $@

# PyTorch and what its CUDA builds bring stay without digests: any index's build will do.
lock: $(STAMP) $(TOOLS)/.complete
	{ sed -n '/^#/p' constraints.txt; \
	  $(BIN)/python -m pip freeze --all --exclude-editable --exclude pip --exclude wheel \
	    | sed 's/+[a-z0-9.]*$$//' | grep -v '^nvidia\|^triton'; } > constraints.tmp
	mv constraints.tmp constraints.txt
	$(TOOLS)/bin/uv pip compile pyproject.toml --all-extras --universal --python-version 3.11 \
	  -c constraints.txt --generate-hashes --no-header --no-annotate --quiet --unsafe-package torch \
	  | awk '/^[^ ]/ { keep = !/^(nvidia|cuda|triton)/ } keep' > requirements.tmp
	mv requirements.tmp requirements.lock
	$(TOOLS)/bin/cyclonedx-py environment $(BIN)/python --pyproject pyproject.toml --mc-type library \
	  --output-reproducible -o sbom.tmp
	mv sbom.tmp sbom.cdx.json
	touch $(STAMP)

audit: $(TOOLS)/.complete
	$(TOOLS)/bin/pip-audit --strict --disable-pip --no-deps -r requirements.lock

release: $(STAMP) $(TOOLS)/.complete
	$(BIN)/python benchmarks/release.py --tools $(TOOLS)/bin $(foreach python,$(PYTHONS),--python $(python))

# In an environment of their own: what the project is tested with stays what constraints.txt names.
$(TOOLS)/.complete: $(STAMP)
	$(PYTHON) -m venv $(TOOLS)
	$(TOOLS)/bin/python -m pip install 'build~=1.6' 'cyclonedx-bom~=7.5' 'pip-audit~=2.10' 'twine~=7.0' 'uv~=0.13.9'
	touch $@

clean:
	rm -rf $(VENV) site .pytest_cache .mypy_cache .ruff_cache .import_linter_cache \
	  .hypothesis .coverage .coverage.*
