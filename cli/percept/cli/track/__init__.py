"""`percept track`: tracks and lights of a finished run again, with other settings."""
