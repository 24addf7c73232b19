"""Shared widgets: forms, theme, shortcuts, background work."""
