"""Reports, pictures and views of calibrations."""
