"""Shortcut sheet, welcome page and hints."""
