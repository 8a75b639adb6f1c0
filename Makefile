# `make demo` and `make test` do all their own set-up in .venv; nothing else needs to be installed by hand.

VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
SAM3   := $(VENV)/.sam3

# Libraries with threads of their own wait for one another on a busy machine; one each is fastest here.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1

.PHONY: demo test check setup format clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt deploy/setup-venv.sh
	sh deploy/setup-venv.sh $(VENV)
	touch $(STAMP)

# For the tests of backend sam3 only; they are skipped where this cannot be had.
$(SAM3): $(STAMP) deploy/setup-sam3.sh
	sh deploy/setup-sam3.sh $(VENV)
	touch $(SAM3)

demo: $(STAMP)
	$(BIN)/motiondlo demo --out out/demo

test: check $(SAM3)
	$(BIN)/pytest -q -n 2 -m "not live"
	$(BIN)/pytest -q -m live

check: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(STAMP)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) out dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
