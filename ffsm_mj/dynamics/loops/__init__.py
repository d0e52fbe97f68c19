"""Closed kinematic loops: latches between bodies of one model, held by bilateral constraints at the acceleration level."""
