"""Objects over time: identities, velocities and stable classes from single detections."""
