"""Beam model: shape functions, Galerkin matrices, poles and receptance."""
