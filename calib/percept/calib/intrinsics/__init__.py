"""What a camera does to rays: solver, validation, coverage, verdict."""
