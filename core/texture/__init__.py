"""The best photo for every face: visibility, view selection, UVs, colour, atlas."""
