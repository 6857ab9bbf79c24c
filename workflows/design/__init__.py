"""The study of design for a target."""
