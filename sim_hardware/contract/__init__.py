"""Deprecated path of the conformance suites of drivers, which are in `sim_hardware.testing`."""
