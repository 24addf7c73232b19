"""Identification: parameters of a specimen with standard errors, from observations."""
