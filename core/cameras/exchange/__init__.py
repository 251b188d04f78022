"""Cameras with their poses from and to other programs."""
