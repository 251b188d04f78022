"""What is drawn over photos and the scan: the outlines and faces of marked regions."""
