"""The layers of the package, in one place: each imports only those before it."""

LAYERS = (
    *("result", "calls", "arguments", "extensions", "minimisers", "networks", "generators", "linalg", "precision"),
    *("critical", "certificates", "springs", "lengths", "optimisation", "response", "paths"),
    *("engine", "figures", "extras", "command", "__main__"),
)
