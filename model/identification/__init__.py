"""Identification: from observations of one specimen to parameters with their errors, and to what the data cannot tell."""
