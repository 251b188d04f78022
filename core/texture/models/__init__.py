"""Models to deliver: atlases, coloured points, simplified meshes, OBJ, pictures."""
