"""Fresco: lays photographs onto laser scans. Computation is in `core`, Blender in `addon`."""


def register() -> None:
    """Register the extension in Blender."""
    from . import addon

    addon.register()


def unregister() -> None:
    """Remove everything that `register` added."""
    from . import addon

    addon.unregister()
