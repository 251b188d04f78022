"""The project file: reading, checking and writing it."""
