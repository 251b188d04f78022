"""Image regions, surface regions, growing, proposals."""
