"""Percolation of stress against the spread of the rest lengths and the size of the network."""
