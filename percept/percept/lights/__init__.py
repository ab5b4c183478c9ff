"""Traffic lights over time: which light a box is, what it shows, whether it flashes."""
