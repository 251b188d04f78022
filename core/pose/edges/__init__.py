"""Refinement of one pose by edges of the scan: silhouettes, depth steps, creases, colour."""
