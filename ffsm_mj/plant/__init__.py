"""What surrounds the motion: actuation within limits, the ledger, samples of live arrays."""
