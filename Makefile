# Two commands do everything: `make study` and `make test`. `make docs` builds the site (results/site). `make bench` compares with other libraries; `make bench SHORT=1` in minutes.
# `make field DATA=FOLDER` takes on somebody else's records (docs/field.md): an hour and a half, interruptible; FOLDER holds openfast/ and bjorko/.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PEERS := .venv-peers
STUDY ?= results/study

# Libraries' modules are compiled where they are first used, and once for every process that tests start.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: study test tests kernels test-all lint types bench field validation docs wheel clean

# $(call timed,WHAT,COMMAND) says how long a step took.
timed = @begun=$$(date +%s); echo "$(1) …"; $(2) && echo "$(1): $$(($$(date +%s) - begun)) s"

study: $(VENV)/.core
	$(call timed,study,$(BIN)/windsysid study --output $(STUDY) --overwrite)

# What most tests need is compiled first, since each of the two workers would compile it for itself; beside it the rest is installed and types of src are checked.
test: $(VENV)/.core
	@$(MAKE) --no-print-directory -j 2 lint tests

kernels: $(VENV)/.core
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.compile_kernels

# Both workers would rewrite every test's assertions to print their values: only tests that fail are run again with them.
tests: kernels $(VENV)/.installed
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal -q --assert=plain \
	  || { OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q --last-failed --last-failed-no-failures none; exit 1; }

test-all: lint types $(VENV)/.notebooks
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile -q -m "slow or not slow"

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy src

# Types of tests and validation too, which take two thirds as long again as those of src and protect no user.
types: $(VENV)/.installed
	$(BIN)/mypy

PIP_INSTALL = $(BIN)/python -m pip install --no-compile --quiet --disable-pip-version-check -c constraints.txt

# A study needs the core alone; `make test` and all else install the rest, and do not build windsysid again for it.
$(VENV)/.core: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "windsysid needs Python 3.11 or newer; got $$($(PYTHON) --version). Try: make PYTHON=python3.12 ..."; exit 2; }
	$(call timed,environment,(test -d $(VENV) || $(PYTHON) -m venv $(VENV)))
	$(call timed,installation,$(PIP_INSTALL) -e .)
	@touch $@

$(VENV)/.installed: $(VENV)/.core
	$(call timed,installation of what tests need,$(PIP_INSTALL) "windsysid[all$(comma)dev]")
	@touch $@

comma := ,

$(VENV)/.notebooks: $(VENV)/.installed
	$(PIP_INSTALL) "windsysid[notebooks]"
	@touch $@

bench: $(VENV)/.installed $(PEERS)/.installed
	$(BIN)/python benchmarks/bench.py --peers $(PEERS)/bin/python $(if $(SHORT),--short)

$(PEERS)/.installed: pyproject.toml constraints.txt benchmarks/peers.txt
	test -d $(PEERS) || $(PYTHON) -m venv $(PEERS)
	$(PEERS)/bin/python -m pip install --no-compile --quiet --disable-pip-version-check -c constraints.txt -e . -r benchmarks/peers.txt
	touch $@

# `make validation` proves what "trust: yes" is worth (docs/adversary.md): many hours, interruptible; RUNS=1 is a first look.
RUNS ?= 40

validation: $(VENV)/.installed
	$(BIN)/python -m validation.adversary.calibrate
	$(BIN)/python -m validation.adversary --runs $(RUNS)

FIELD := results/field

field: $(VENV)/.installed $(PEERS)/.installed
	@test -d "$(DATA)/openfast" -a -d "$(DATA)/bjorko" || { echo "make field: expected DATA=FOLDER with openfast/ and bjorko/, got '$(DATA)'"; exit 2; }
	mkdir -p $(FIELD)
	$(BIN)/python -m validation.bjorko --data $(DATA)/bjorko/pull_release_10Hz.csv > $(FIELD)/bjorko.txt
	$(BIN)/python -m validation.hammond > $(FIELD)/hammond.txt
	$(BIN)/python -m validation.years > $(FIELD)/years.txt
	$(BIN)/python -m validation.field --openfast $(DATA)/openfast --output $(FIELD) > $(FIELD)/openfast.txt
	PYTHONPATH=. $(PEERS)/bin/python benchmarks/subspace.py --openfast $(DATA)/openfast --output $(FIELD) > $(FIELD)/subspace.txt
	@cat $(FIELD)/*.txt

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs results/site
	@echo "site: results/site/index.html"

$(VENV)/.docs: $(VENV)/.installed
	$(PIP_INSTALL) "windsysid[docs]"
	touch $@

# `make wheel` writes dist/*.whl with machine code for the Python and Numba of this environment; others compile.
IN_THE_WHEEL := src/windsysid/kernels/in_the_wheel

wheel: $(VENV)/.core
	rm -rf $(IN_THE_WHEEL) build
	WINDSYSID_CACHE=$(IN_THE_WHEEL) $(BIN)/windsysid warm --portable
	$(BIN)/python -m pip wheel --no-deps --quiet --wheel-dir dist .; ended=$$?; rm -rf $(IN_THE_WHEEL); exit $$ended

clean:
	rm -rf $(VENV) $(PEERS) results .mypy_cache .ruff_cache .pytest_cache
