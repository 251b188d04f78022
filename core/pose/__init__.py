"""Camera poses: from regions, from points, by edges, jointly; with their uncertainty."""
