"""The vocabulary of percept: time, frames, samples, rigs, results, settings and errors."""
