"""Static, modal, frequency and time responses of the tactor."""
