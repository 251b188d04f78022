"""Regions on the scan: the wand over faces or points, its index, openings, files, proposals."""
