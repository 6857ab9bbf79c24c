"""Extras: one folder a capability.  Each imports the scene; any folder can be deleted."""
