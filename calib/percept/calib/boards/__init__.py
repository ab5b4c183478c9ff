"""Calibration boards: what they are, and finding them in images."""
