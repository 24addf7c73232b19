"""Commands of a laboratory: operator of the day, second person, many specimens, audit trail, certificates."""
