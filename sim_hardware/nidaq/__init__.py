"""The simulated NI card."""
