"""The synthetic world: a deterministic street with exact truth, and the sensors that see it."""
