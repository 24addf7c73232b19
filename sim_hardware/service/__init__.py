"""The simulated bench as a process."""
