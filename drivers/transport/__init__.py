"""Instrument transports: SCPI, VISA, serial port, safe ramp-down."""
