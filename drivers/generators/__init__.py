"""Function generators: burst and arbitrary-waveform sources."""
