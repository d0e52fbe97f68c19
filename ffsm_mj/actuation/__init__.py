"""What surrounds the motion: actuation within limits, the balance, samples of live arrays."""
