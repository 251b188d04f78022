"""Refinement of all poses together: features matched between photos, met on the scan."""
