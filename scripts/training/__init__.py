"""The training of the detector that ships; see `scripts/train-detector`."""
