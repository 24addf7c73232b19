"""NI DAQ: analog input and analog output."""
