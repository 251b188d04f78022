"""The stages of a run: poses, refinement, textures, models, cameras."""
