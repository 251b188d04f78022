"""The project file, its stages and their provenance."""
