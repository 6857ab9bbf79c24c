"""Parts that several studies of critflow-extras share."""
