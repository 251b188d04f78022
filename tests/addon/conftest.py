"""Small scenes for the add-on's tests; the extension's own modules are reached by name."""

import importlib

import pytest

MODULE = "bl_ext.user_default.fresco"


@pytest.fixture
def module(extension):
    """Return a function that imports a module of the installed extension: `module("addon.jobs")`."""
    return lambda name: importlib.import_module(f"{MODULE}.{name}")
