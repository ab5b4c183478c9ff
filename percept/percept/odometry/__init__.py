"""Where the vehicle was: poses from what a log has, or from its LiDAR."""
