# make demo: set everything up and run the sample project. make test: set everything up and run the checks.
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: demo test setup lint extension clean

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml tools/setup.sh
	sh tools/setup.sh $(VENV)
	touch $@

demo: setup
	$(BIN)/fresco run sample/project.toml

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test: setup lint
	$(BIN)/pytest

clean:
	rm -rf $(VENV) build dist wheels demo-output artefacts *.egg-info
