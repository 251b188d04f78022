"""The only place where Blender's data and numpy meet, and where axes and pixel conventions change."""
