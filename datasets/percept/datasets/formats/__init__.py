"""Log formats: their records, sound or damaged, as raw messages; and their writers."""
