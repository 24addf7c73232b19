"""Shared services: errors, formatting, units, progress, undo and atomic writing."""
