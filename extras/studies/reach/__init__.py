"""Which linear responses a network can have: stresses of any sign and positive ones, Poisson ratios, onsets."""
