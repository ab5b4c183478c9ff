"""A capture for calibration in the synthetic street, with exact truth."""
