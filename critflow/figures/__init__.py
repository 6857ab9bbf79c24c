"""Networks and distributions as matplotlib figures."""
