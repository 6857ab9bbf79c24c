"""Disordered networks in space: the edges of random foams."""
