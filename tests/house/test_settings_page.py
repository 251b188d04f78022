"""docs/settings.md says of every setting what the code says."""

import dataclasses
import importlib.util
import inspect
from pathlib import Path

import pytest
from fresco.core import settings

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def tool():
    """Return the module that writes the page."""
    spec = importlib.util.spec_from_file_location("settings_page", ROOT / "tools" / "settings_page.py")
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def test_the_page_is_current(tool):
    written = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8")
    assert written == tool.page(), "run: .venv/bin/python tools/settings_page.py"


def test_every_setting_of_the_code_is_on_it(tool):
    kinds = [kind for _, kind in inspect.getmembers(settings, dataclasses.is_dataclass)]
    assert {kind for _, of in tool.SECTIONS for kind in of} >= set(kinds)
    for kind in kinds:
        missing = {field.name for field in dataclasses.fields(kind)} - set(settings.field_texts(kind))
        assert not missing, f"{kind.__name__}: {missing} say nothing"
