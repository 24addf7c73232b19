"""Import of measured tables and time series as run files."""
