# make demo   train with a demonstrator, drive, and write runs/demo/report.html
# make test   run the tests
# make coverage  run the tests and measure what they cover, which takes half as long again
# make check  run the linters and build the documentation; CI runs `make check coverage`
# make docs   serve the documentation at http://127.0.0.1:8000
# make setup  make .venv with everything in it; the others do so by themselves
# make lock   write the versions that are in .venv to constraints.txt
# make clean  remove .venv and caches; runs/ stays

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.complete
WORKERS ?= 2

export PIP_DISABLE_PIP_VERSION_CHECK := 1

# Tests start many processes: compiled modules are kept, whatever the shell says.
export PYTHONDONTWRITEBYTECODE :=

# Without it, a banner about the theme's successor stands in every log.
export NO_MKDOCS_2_WARNING := 1

.PHONY: demo test coverage check docs fuzz setup lock clean

demo: $(STAMP)
	$(BIN)/steersman demo --out runs/demo

# One thread for each test process: WORKERS is what uses the cores.
test: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/pytest -n $(WORKERS) --dist worksteal

coverage: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/pytest -n $(WORKERS) --dist worksteal --cov --cov-report=term

fuzz: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/fuzz.py

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
$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "steersman needs Python 3.11 or newer, and $(PYTHON) is $$($(PYTHON) -V 2>&1 || true);" \
	       "name another with: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "$(PYTHON) cannot make virtual environments; on Debian or Ubuntu:" \
	       "apt-get install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -c constraints.txt -e '.[train,tune,report,notebook,video,live,bench,logs,minari,ray,carla,docs,dev]'
	touch $@

lock: $(STAMP)
	{ sed -n '/^#/p' constraints.txt; \
	  $(BIN)/python -m pip freeze --all --exclude-editable --exclude pip --exclude wheel \
	    | sed 's/+[a-z0-9.]*$$//' | grep -v '^nvidia\|^triton'; } > constraints.tmp
	mv constraints.tmp constraints.txt
	touch $(STAMP)

clean:
	rm -rf $(VENV) site .pytest_cache .mypy_cache .ruff_cache .import_linter_cache \
	  .hypothesis .coverage .coverage.*
