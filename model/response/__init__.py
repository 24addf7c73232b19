"""Static, modal, frequency and time responses of the beam."""
