"""The simulated plant: parameters, beam, laser view, faults, voltage history."""
