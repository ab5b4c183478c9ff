"""Whether a calibration still holds."""
