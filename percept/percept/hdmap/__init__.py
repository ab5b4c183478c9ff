"""HD maps: what stands in a Lanelet2 file."""
