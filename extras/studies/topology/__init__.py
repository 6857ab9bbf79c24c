"""Networks whose edges are cut: fracture and remodelling at successive onsets, and pruning at constant stress."""
