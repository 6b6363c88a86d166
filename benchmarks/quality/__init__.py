"""How right depth maps are: analytic scenes, simulated scans, exact truth, scores and peers."""
