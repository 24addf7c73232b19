"""Contract tests for drivers of sources and digitizers; `__main__` runs them on any driver."""
