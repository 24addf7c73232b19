"""The runner: executes a protocol on an armed bench."""
