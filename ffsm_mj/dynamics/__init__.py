"""Smooth dynamics: free and forced integration steps, steps as paths, and rigid-body quantities."""
