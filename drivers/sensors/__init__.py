"""Laser displacement sensors."""
