"""Boxes of one image: thresholds, suppression, duplicates between models."""
