"""Simulated wires: SCPI engine, TCP server, serial pseudo-terminal."""
