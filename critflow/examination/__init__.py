"""One page about a network: rigid or floppy, why, how stiff, and how to make it critical."""
