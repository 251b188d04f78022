# make demo: set everything up and run the sample project. make test: set everything up and run the checks.
VENV ?= .venv
BIN := $(VENV)/bin
# The add-on's tests run once more in Blender 5.0, which shares Python 3.11 with 4.5.
VENV5 := $(VENV)-blender5

.PHONY: demo test setup lint extension clean

demo: setup
	$(BIN)/fresco run sample/project.toml

test: setup lint
	$(BIN)/pytest
	if $(BIN)/python -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then \
	    $(MAKE) $(VENV5)/.ready && $(VENV5)/bin/pytest tests/addon; fi

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml tools/setup.sh
	sh tools/setup.sh $(VENV)

$(VENV5)/.ready: pyproject.toml tools/setup.sh
	sh tools/setup.sh $(VENV5) 5.0.1

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

extension: setup
	$(BIN)/python tools/build_extension.py build

clean:
	rm -rf .venv .venv-blender5 build dist wheels demo-output artefacts *.egg-info
