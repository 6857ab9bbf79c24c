"""The installed sparse solvers that have an inertia, by name."""

from critflow.sparse import Factor, available_backends

ELIMINATING = {name: kind for name, kind in available_backends().items() if not issubclass(kind, Factor)}
