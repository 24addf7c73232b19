"""Bench page: set-up, calibration, wiring check and commissioning of a bench."""
