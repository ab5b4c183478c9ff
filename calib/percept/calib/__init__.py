"""Calibration. So far: the boards; the solvers follow."""
