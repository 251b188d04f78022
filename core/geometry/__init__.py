"""Shapes and transforms that every room builds on."""
