"""The contract suites that every source and digitizer passes, for the authors of drivers as well: see `__main__`."""
