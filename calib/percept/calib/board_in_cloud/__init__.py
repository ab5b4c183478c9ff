"""A board of known size in a raw cloud: found without a region of interest, and placed."""
