"""Where the objects in boxes are: LiDAR clusters and depth images."""
