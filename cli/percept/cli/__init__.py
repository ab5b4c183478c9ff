"""The command line: thin files, one a command, and the one place that catches errors."""
