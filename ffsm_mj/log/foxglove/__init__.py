"""Topics in Foxglove's well-known schemas, drawn by viewers without set-up."""
