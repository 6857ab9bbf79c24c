"""Which growth with strain goes with which bulk modulus: attained triples, designed curves, one force network."""
