"""The extension, loaded into the bpy wheel of this Python; tests that need no Blender never import it."""

import os
import re
import sys
import tempfile
import warnings
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULE = "bl_ext.user_default.fresco"
_status = 0


def _install(profile: Path) -> None:
    """Put the work tree into a profile as an installed extension, without wheels: pip installed those."""
    package = profile / "extensions" / "user_default" / "fresco"
    package.mkdir(parents=True)
    for name in ("__init__.py", "addon", "core", "presets"):
        (package / name).symlink_to(ROOT / name)
    manifest = (ROOT / "blender_manifest.toml").read_text()
    manifest = re.sub(r"(?ms)^wheels = \[.*?^\]\n", "", manifest)
    (package / "blender_manifest.toml").write_text(manifest)


# Before anything imports bpy; the name has a space and an accent, which every path must bear.
_profile = tempfile.TemporaryDirectory(prefix="fresco pröfile ")
os.environ["BLENDER_USER_RESOURCES"] = _profile.name
_install(Path(_profile.name))


@pytest.fixture(scope="session")
def extension():
    """Return the enabled extension's module, in a profile of its own."""
    pytest.importorskip("bpy", reason="the bpy wheel is not installed")
    import addon_utils

    def fail(error):
        raise error

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Blender's own
        addon_utils.extensions_refresh(ensure_wheels=True, addon_modules_pending=[MODULE])
        assert addon_utils.enable(MODULE, default_set=True, persistent=True, handle_error=fail)
    return sys.modules[MODULE]


@pytest.fixture
def context(extension):
    """Return Blender's context with an empty scene. (read_factory_settings would disable the extension.)"""
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context


@pytest.fixture
def scene(context):
    """Return an empty scene."""
    return context.scene


def pytest_sessionfinish(session, exitstatus):
    global _status
    _status = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    # bpy 4.5 hangs at interpreter exit while a Python handler or timer is registered.
    if "bpy" in sys.modules:
        _profile.cleanup()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_status)
