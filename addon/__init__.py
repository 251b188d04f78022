"""Fresco in Blender: operators, panels and what the .blend keeps. Computation is in `core`.

Blender is imported only where it is registered with: the command line can say that it is missing.
"""


def register() -> None:
    """Register everything in Blender."""
    from . import registration

    registration.register()


def unregister() -> None:
    """Undo `register`."""
    from . import registration

    registration.unregister()
