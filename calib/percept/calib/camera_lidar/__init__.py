"""A camera placed on a LiDAR by a board that both see."""
