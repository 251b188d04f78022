"""Operators: one module per stage, the same nouns as in core."""
