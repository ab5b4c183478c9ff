"""The stops of a log: where everything stands still."""
