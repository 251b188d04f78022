"""Regions in a photo: the wand and what it looks at, snapping, GrabCut, proposals."""
