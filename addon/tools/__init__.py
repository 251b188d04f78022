"""Tools of the toolbar: marking regions in photos (Image Editor) and on the scan (3D view)."""
