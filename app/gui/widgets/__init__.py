"""Shared widgets: actions, layouts, forms, theme, background work."""
