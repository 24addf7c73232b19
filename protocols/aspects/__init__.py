"""Aspects of the built-in protocols: a module for each, of the same name as in `protocols.measurements`."""
