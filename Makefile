# make demo   a hexapod walks over an emulated bus, and leaves a folder of results
# make test   all tests but the slowest
# make slow   the slowest, half an hour and more: diagnoses from end to end, of walking robots, ...
# make lint   style, types, import rules
# make bench  speed, each figure against its floor
# make power  a proof of the diagnosis on CASES cases, about a minute each: how large an effect must be
# make prove  the whole proof: 1476 joints and 166 robots, two days or so; Ctrl-C and again goes on
# make lock   renew requirements.lock from pyproject.toml

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
ROBOT ?= marvin
SEED ?= 1
CASES ?= 100

.PHONY: demo test slow lint bench power prove lock clean

demo: $(READY)
	$(BIN)/busemu demo --robot $(ROBOT)

# each worker has a core: threads of a library's own would only wait for one another; files in order, the long ones first
test: $(READY)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -n auto --dist loadfile --no-loadscope-reorder --max-worker-restart 0 -m 'not slow and not pty'
	$(BIN)/python -m pytest -q -m 'not slow and pty' $$(grep -rl --include='*.py' 'mark\.pty' tests)

slow: $(READY)
	$(BIN)/python -m pytest -q -m slow

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(READY)
	$(BIN)/python -m bench.speed

power: $(READY)
	$(BIN)/busemu prove --seed $(SEED) --cases $(CASES) --out out/power-$(SEED)

prove: $(READY)
	$(BIN)/busemu prove --seed $(SEED) --active --baselines 100 --robots 166 --out out/proof-$(SEED)

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || \
	  echo 'note: PyBullet has no wheel for a Python later than 3.11; pip builds it (about 4 minutes)'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $(READY)

lock:
	$(BIN)/python -m pip install --quiet pip-tools
	$(BIN)/pip-compile --quiet --strip-extras --allow-unsafe --generate-hashes --no-emit-index-url --no-emit-find-links --all-extras --output-file requirements.lock pyproject.toml

clean:
	rm -rf $(VENV) build *.egg-info
