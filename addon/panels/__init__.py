"""The tab in the 3D view's sidebar: one module per step."""
