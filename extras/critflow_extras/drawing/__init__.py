"""Pictures of networks, configurations and states, in the plane and in space."""
