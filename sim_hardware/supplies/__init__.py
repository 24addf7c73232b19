"""Simulated DC supplies."""
