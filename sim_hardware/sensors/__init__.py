"""Simulated laser sensors."""
