"""Networks of other programs in and out, and their repair."""
