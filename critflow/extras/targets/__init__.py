"""Design for target values, by stresses, stiffnesses, rest lengths or faces."""
