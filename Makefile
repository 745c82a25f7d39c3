# `make leaderboard` and `make test` do everything on a machine with Python >= 3.11 and make.

PYTHON ?= python3
VENV ?= .venv
PAGE ?= build/leaderboard.html

BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.DEFAULT_GOAL := help
.PHONY: help install leaderboard test check format coverage docs films wheel audit floors clean

help: ## show this list
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 14

install: $(INSTALLED) ## create .venv and install what the other targets need

leaderboard: $(INSTALLED) ## fly every law and the shipped policy on the public seeds, write a page
	@mkdir -p $(dir $(PAGE))
	$(BIN)/python -m eval.leaderboard --backend processes --html $(PAGE)
	@echo "The page is $(abspath $(PAGE))"

test: $(INSTALLED) ## run the tests, then those of the kernels without compilation
	$(BIN)/python -m pytest --numprocesses auto --dist loadfile
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest --numprocesses auto --dist loadfile -m kernel

check: $(INSTALLED) ## formatting, lint, types and import contracts
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports --no-logo

format: $(INSTALLED) ## format the sources and mend what the linter can
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

coverage: $(INSTALLED) ## which lines the tests reach, kernels included
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest
	NUMBA_DISABLE_JIT=1 $(BIN)/coverage run --append -m pytest -m kernel
	$(BIN)/coverage report
	$(BIN)/coverage report --include='visenvs/*' --format=total --fail-under=90

docs: $(INSTALLED) ## build the documents into build/docs, tutorials executed, warnings as errors
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	PYTHONPATH=$(CURDIR) $(BIN)/python -m sphinx -W --keep-going -q docs build/docs
	@echo "The documents are $(abspath build/docs/index.html)"

wheel: $(INSTALLED) ## build sdist and wheel into dist, fly every id from the wheel alone
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt build
	rm -rf dist
	$(BIN)/python -m build --outdir dist
	$(BIN)/python -m pytest -m wheel

films: $(INSTALLED) ## fly the moving pictures of the documents anew
	$(BIN)/python -m eval.gallery

audit: $(INSTALLED) ## look the pinned packages up in the database of known vulnerabilities
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pip-audit
	$(BIN)/pip-audit --disable-pip --no-deps --strict --progress-spinner off -r constraints.txt

floors: ## install the oldest versions that pyproject.toml allows, fly every id
	rm -rf build/floors && $(PYTHON) -m venv build/floors
	$(PYTHON) tests/floors.py > build/floors.txt
	build/floors/bin/python -m pip install --quiet --disable-pip-version-check -c build/floors.txt .
	build/floors/bin/python tests/floors.py fly

clean: ## remove .venv and everything else that the targets made
	rm -rf $(VENV) build dist .coverage .hypothesis .import_linter_cache .pytest_cache .ruff_cache
	find visenvs agents train eval tests -name __pycache__ -type d -prune -exec rm -rf {} +

# A second `make` installs nothing unless the dependencies have changed.
$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "visenvs needs Python >= 3.11, $(PYTHON) is $$($(PYTHON) -V 2>&1); write: make PYTHON=python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@
