"""Laser scans: reading, checking, aligning."""
