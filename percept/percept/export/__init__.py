"""Part of percept."""
