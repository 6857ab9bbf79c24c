"""Studies that measure the library itself."""
