"""Shape functions, Galerkin matrices and poles of the beam."""
