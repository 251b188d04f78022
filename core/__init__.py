"""All computation of Fresco: numpy in, numpy out, never any Blender."""
