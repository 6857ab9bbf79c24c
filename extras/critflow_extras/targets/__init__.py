"""Design for target values, by changes of stresses or of faces."""
