"""Parameter identification from run files, calibrations and the active model."""
