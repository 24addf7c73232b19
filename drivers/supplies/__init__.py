"""DC supplies as sources."""
