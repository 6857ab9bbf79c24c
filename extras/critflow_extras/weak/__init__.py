"""Weak forces added to a critical network: bending, soft springs, point forces, temperature."""
