"""Camera poses from points: markers found in photos, surveyed coordinates, hand-picked pairs."""
