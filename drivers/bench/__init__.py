"""The bench: amplifier drive limits, rest verification, safe shutdown."""
