"""The parts of `scripts/docs-pictures`."""
