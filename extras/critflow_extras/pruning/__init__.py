"""The part of a network that can carry tension, and the digits of coordinates in files."""
