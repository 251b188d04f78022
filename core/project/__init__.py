"""The project file, the stages of a run, provenance and resuming."""
